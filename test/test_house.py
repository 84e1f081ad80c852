# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The house keeps its order: what may import what, how long things are, what is declared."""

import ast
from collections.abc import Callable
from pathlib import Path
import re
import subprocess
import sys
from xml.etree import ElementTree

import pytest
from support import house
from support.house import BORDER
from support.house import PACKAGE
from support.house import ROOT
from support.house import ROWS

import ivfmc_ros

MODULES = house.sources(PACKAGE)
CORE = [path for path in MODULES if house.row_of(house.module_name(path)) not in BORDER]
HEADER = '# Copyright 2026 the ivfmc_ros authors\n# SPDX-License-Identifier: Apache-2.0\n'
ROS = re.compile(
    r'^(rcl\w*|rosidl\w*|rosbag2\w*|ros2\w*|rpyutils|\w+_msgs|std_srvs|rcl_interfaces'
    r'|builtin_interfaces|ament_\w+|tf2_\w+|launch\w*|cv_bridge|sensor_msgs_py)$'
)
MAX_FUNCTION_LINES = 60
MAX_FILE_LINES = 400


def is_ros(module: str) -> bool:
    return bool(ROS.match(module.split('.', maxsplit=1)[0]))


def is_ours(module: str) -> bool:
    return module.split('.', maxsplit=1)[0] == PACKAGE


def our_imports(path: Path) -> list[str]:
    return [name for name in house.imports_of(path) if is_ours(name)]


def places(paths: list[Path], is_wrong: Callable[[ast.AST], bool]) -> list[str]:
    """Give file:line of every piece of the sources that breaks a rule."""
    found = []
    for path in paths:
        wrong = [node for node in ast.walk(house.parse(path)) if is_wrong(node)]
        found += [f'{path.relative_to(ROOT)}:{getattr(node, "lineno", 0)}' for node in wrong]
    return found


@pytest.mark.parametrize(
    'name', ['rclpy', 'rclpy.node', 'sensor_msgs.msg', 'std_srvs.srv', 'ament_index_python']
)
def test_ros_names_are_recognised(name):
    assert is_ros(name)


@pytest.mark.parametrize('name', ['numpy', 'mcap.writer', 'ivfmc_ros.storage.ros_msgs', 'ros'])
def test_other_names_are_not_taken_for_ros(name):
    assert not is_ros(name)


@pytest.mark.parametrize(
    ('line', 'is_package', 'name'),
    [
        ('from ivfmc_ros import nodes', False, 'ivfmc_ros.nodes'),
        ('from . import nodes', True, 'ivfmc_ros.cell.nodes'),
        ('from ..nodes import camera', False, 'ivfmc_ros.cell.nodes.camera'),
        ('from ..nodes import camera', True, 'ivfmc_ros.nodes.camera'),
        ('def f():\n    import rclpy.node', False, 'rclpy.node'),
    ],
)
def test_no_form_of_import_is_missed(line, is_package, name):
    module = 'ivfmc_ros.cell' if is_package else 'ivfmc_ros.cell.axis.fit'
    assert list(house.imported_modules(ast.parse(line), module, is_package=is_package)) == [name]


def test_core_names_no_ros_package():
    named = {house.module_name(path): house.imports_of(path) for path in CORE}
    assert [(module, name) for module in named for name in named[module] if is_ros(name)] == []


def test_core_loads_no_ros_package():
    names = [house.module_name(path) for path in CORE if path.name != '__main__.py']
    program = (
        'import importlib, sys\n'
        f'for name in {names!r}: importlib.import_module(name)\n'
        "print('\\n'.join(sorted(sys.modules)))"
    )
    answer = subprocess.run(
        [sys.executable, '-c', program], capture_output=True, text=True, cwd=ROOT, check=False
    )
    assert answer.returncode == 0, answer.stderr
    loaded = answer.stdout.split()
    assert set(names) <= set(loaded)
    border = [f'{PACKAGE}.{row}' for row in BORDER]
    assert [name for name in loaded if is_ros(name) or name in border] == []


def test_nobody_imports_the_border():
    rows = {path: {house.row_of(name) for name in our_imports(path)} for path in CORE}
    assert [str(path) for path in CORE if not rows[path].isdisjoint(BORDER)] == []


def test_data_flows_down_the_house():
    upward = []
    for path in MODULES:
        module = house.module_name(path)
        rank = ROWS.index(house.row_of(module))
        above = [name for name in our_imports(path) if ROWS.index(house.row_of(name)) > rank]
        upward += [f'{module} imports {name}' for name in above]
    assert upward == [], f'a module may import only from its own row or an earlier one of {ROWS}'


def test_the_rooms_of_a_package_form_no_cycle():
    """A room is a sub-package or a single file of a package; two rooms never need each other."""
    imports = house.imports_between_rooms(MODULES)
    assert house.cycles(imports) == []


def test_cycles_between_rooms_are_found():
    assert house.cycles({'a': {'b'}, 'b': {'c'}, 'c': {'b'}, 'd': {'a'}}) == ['b', 'c']


def test_every_public_class_name_has_one_meaning():
    places: dict[str, list[str]] = {}
    for path in MODULES:
        for node in house.parse(path).body:
            if isinstance(node, ast.ClassDef) and not node.name.startswith('_'):
                places.setdefault(node.name, []).append(house.module_name(path))
    assert {name: where for name, where in places.items() if len(where) > 1} == {}


def test_every_folder_has_its_row():
    assert {house.row_of(house.module_name(path)) for path in MODULES} <= set(ROWS)


def test_every_file_begins_with_the_copyright():
    files = [ROOT / 'setup.py', *house.sources(PACKAGE, 'test')]
    bare = [path for path in files if not path.read_text(encoding='utf-8').startswith(HEADER)]
    assert bare == []


def test_no_bare_except():
    assert places(MODULES, lambda n: isinstance(n, ast.ExceptHandler) and n.type is None) == []


def test_no_assert_in_the_package():
    # python -O removes them
    assert places(MODULES, lambda n: isinstance(n, ast.Assert)) == []


def test_no_print_outside_the_command():
    quiet = [
        path
        for path in MODULES
        if house.row_of(house.module_name(path)) not in ('cli', 'examples')
    ]
    assert places(quiet, is_print) == []


def is_print(node: ast.AST) -> bool:
    called = node.func if isinstance(node, ast.Call) else None
    return isinstance(called, ast.Name) and called.id == 'print'


def test_functions_are_short():
    assert places(MODULES, is_long_function) == []


def is_long_function(node: ast.AST) -> bool:
    if not isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
        return False
    return (node.end_lineno or node.lineno) - node.lineno + 1 > MAX_FUNCTION_LINES


def test_files_are_short():
    lengths = {path: len(path.read_text(encoding='utf-8').splitlines()) for path in MODULES}
    assert [path for path in MODULES if lengths[path] > MAX_FILE_LINES] == []


def setup_arguments() -> dict[str, ast.expr]:
    tree = house.parse(ROOT / 'setup.py')
    calls = [node for node in ast.walk(tree) if isinstance(node, ast.Call)]
    call = next(c for c in calls if isinstance(c.func, ast.Name) and c.func.id == 'setup')
    return {keyword.arg: keyword.value for keyword in call.keywords if keyword.arg}


def manifest() -> ElementTree.Element:
    return ElementTree.parse(ROOT / 'package.xml').getroot()


def test_versions_agree():
    top = re.search(r'^(\d+\.\d+\.\d+) \(', (ROOT / 'CHANGELOG.rst').read_text(), re.MULTILINE)
    assert top is not None
    assert {
        'setup.py': ast.literal_eval(setup_arguments()['version']),
        'CHANGELOG.rst': top.group(1),
        '__init__.py': ivfmc_ros.__version__,
    } == dict.fromkeys(
        ('setup.py', 'CHANGELOG.rst', '__init__.py'), manifest().findtext('version')
    )


def test_manifest_is_an_ament_python_package():
    assert manifest().get('format') == '3'
    assert manifest().findtext('name') == PACKAGE
    assert manifest().findtext('export/build_type') == 'ament_python'
    assert manifest().findtext('license') == 'Apache-2.0'


def test_manifest_names_what_pip_would_install():
    keys = ' '.join(node.text or '' for node in manifest().iter('exec_depend'))
    wanted = ast.literal_eval(setup_arguments()['install_requires'])
    names = {re.split(r'[<>=]', item)[0].removesuffix('-python-headless') for item in wanted}
    # no keys: zstandard comes with mcap, fast-simplification is named beside open3d
    names -= {'zstandard', 'fast-simplification'}
    assert {name for name in names if name.removeprefix('py') not in keys} == set()


def test_every_node_has_its_executable():
    names = {path.name for path in (ROOT / 'resource' / 'executables').iterdir()}
    nodes = {path.stem for path in (ROOT / PACKAGE / 'nodes').glob('*.py')}
    assert names
    assert names <= nodes
    bare = [path for path in MODULES if 'nodes' in path.parts and has_main(path)]
    assert {path.stem for path in bare} == names


def has_main(path: Path) -> bool:
    return any(
        isinstance(node, ast.FunctionDef) and node.name == 'main'
        for node in house.parse(path).body
    )


def test_settings_of_tools_do_not_describe_the_package():
    # colcon takes name and version from setup.py; a second description would compete with it
    text = (ROOT / 'pyproject.toml').read_text(encoding='utf-8')
    assert re.findall(r'^\[(?:project|build-system)', text, re.MULTILINE) == []
