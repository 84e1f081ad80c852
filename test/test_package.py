# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The package installs with pip and with colcon, and the command runs from both."""

import configparser
import importlib.util
import os
from pathlib import Path
import re
import shutil
import subprocess
import sys
import zipfile

import pytest
from support.house import ROOT

import ivfmc_ros
from ivfmc_ros.cli.support.cell_run import NODES
from ivfmc_ros.cli.support.cell_run import WINDOW

PARTS = ('config', 'ivfmc_ros', 'resource', 'test')
FILES = ('LICENSE', 'README.md', 'package.xml', 'pyproject.toml', 'setup.cfg', 'setup.py')
PIP = (sys.executable, '-m', 'pip', '--disable-pip-version-check')
ANSWER = re.compile(rf'\b{re.escape(ivfmc_ros.__version__)}\b')
needs_colcon = pytest.mark.skipif(
    importlib.util.find_spec('colcon_core') is None, reason='colcon is not installed'
)


def can_build_wheels() -> bool:
    """Whether setuptools is here and makes wheels: since 70.1 by itself."""
    if importlib.util.find_spec('setuptools') is None:
        return False
    makers = ('wheel', 'setuptools.command.bdist_wheel')
    return any(importlib.util.find_spec(name) for name in makers)


needs_wheels = pytest.mark.skipif(
    not can_build_wheels(), reason='no setuptools that builds wheels is installed'
)


@pytest.fixture(scope='module')
def sources(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Copy of the sources, because pip and setuptools write beside what they build."""
    folder = tmp_path_factory.mktemp('workspace') / 'ivfmc_ros'
    folder.mkdir()
    for name in PARTS:
        if (ROOT / name).is_dir():
            ignored = shutil.ignore_patterns('__pycache__')
            shutil.copytree(ROOT / name, folder / name, ignore=ignored)
    for name in FILES:
        shutil.copy(ROOT / name, folder)
    return folder


@pytest.fixture(scope='module')
def wheel(sources: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp('wheel')
    run([*PIP, 'wheel', '--no-deps', '--no-build-isolation', '-w', str(folder), str(sources)])
    return next(folder.glob('ivfmc_ros-*.whl'))


@pytest.fixture(scope='module')
def workspace(sources: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Folder in which colcon has built the package."""
    folder = tmp_path_factory.mktemp('colcon')
    run([sys.executable, '-m', 'colcon', 'build', '--base-paths', str(sources)], cwd=folder)
    return folder


def run(command: list[str], *, cwd: Path | None = None, **environment: str) -> str:
    """Run ``command`` without this run's settings of pytest, colcon and Python."""
    inherited = {k: v for k, v in os.environ.items() if not k.startswith(('COLCON', 'PYTEST'))}
    inherited.pop('PYTHONPATH', None)
    result = subprocess.run(
        command,
        cwd=cwd,
        env=inherited | environment,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )
    assert result.returncode == 0, f'{command}\n{result.stdout}\n{result.stderr}'
    return result.stdout


def config_files() -> set[str]:
    return {str(path.relative_to(ROOT)) for path in (ROOT / 'config').rglob('*') if path.is_file()}


@needs_wheels
def test_wheel_holds_what_ros_looks_for(wheel):
    data = f'ivfmc_ros-{ivfmc_ros.__version__}.data/data/share'
    names = set(zipfile.ZipFile(wheel).namelist())
    assert f'{data}/ament_index/resource_index/packages/ivfmc_ros' in names
    assert f'{data}/ivfmc_ros/package.xml' in names
    assert {f'{data}/ivfmc_ros/{name}' for name in config_files()} <= names


@needs_wheels
def test_wheel_holds_every_module_and_no_test(wheel):
    names = set(zipfile.ZipFile(wheel).namelist())
    modules = {str(path.relative_to(ROOT)) for path in (ROOT / 'ivfmc_ros').rglob('*.py')}
    # the launch file is data
    share = f'ivfmc_ros-{ivfmc_ros.__version__}.data/data/share/ivfmc_ros/config/'
    code = {name for name in names if name.endswith('.py') and not name.startswith(share)}
    assert code == modules


@needs_wheels
def test_wheel_is_typed_and_described(wheel):
    files = zipfile.ZipFile(wheel)
    assert 'ivfmc_ros/py.typed' in files.namelist()
    run([sys.executable, '-m', 'twine', 'check', '--strict', str(wheel)])


@needs_wheels
def test_wheel_puts_only_ivfmc_on_the_path(wheel):
    files = zipfile.ZipFile(wheel)
    info = f'ivfmc_ros-{ivfmc_ros.__version__}'
    entries = configparser.ConfigParser()
    entries.read_string(files.read(f'{info}.dist-info/entry_points.txt').decode())
    assert list(entries['console_scripts']) == ['ivfmc']
    assert not [name for name in files.namelist() if '.data/scripts/' in name]
    scripts = {
        Path(member.filename).name
        for member in files.infolist()
        if member.filename.startswith(f'{info}.data/data/lib/ivfmc_ros/')
        and member.external_attr >> 16 & 0o111
    }
    assert scripts == {*NODES, WINDOW}


@needs_wheels
def test_wheel_installs_the_command_into_bin(wheel, tmp_path):
    # without --ignore-installed pip takes away what this environment has, prefix or not
    options = ['--no-deps', '--no-index', '--ignore-installed', '--prefix', str(tmp_path)]
    run([*PIP, 'install', *options, str(wheel)])
    packages = next(tmp_path.glob('**/site-packages'))
    command = str(tmp_path / 'bin' / 'ivfmc')
    assert ANSWER.search(run([command, '--version'], cwd=tmp_path, PYTHONPATH=str(packages)))


@needs_colcon
@pytest.mark.parametrize('place', ['lib/ivfmc_ros', 'bin'])
def test_colcon_installs_the_command(workspace, place):
    script = workspace / 'install' / 'ivfmc_ros' / place / 'ivfmc'
    said = run(['bash', '-c', f'. install/setup.bash && {script} --version'], cwd=workspace)
    assert ANSWER.search(said)


@needs_colcon
def test_colcon_installs_the_nodes_where_ros2_run_looks(workspace):
    folder = workspace / 'install' / 'ivfmc_ros' / 'lib' / 'ivfmc_ros'
    assert {name for name in NODES if not os.access(folder / name, os.X_OK)} == set()
    assert not [name for name in NODES if (folder.parents[1] / 'bin' / name).exists()]


@needs_colcon
def test_sourced_workspace_has_the_command_and_its_own_modules(workspace):
    where = f"{sys.executable} -c 'import ivfmc_ros; print(ivfmc_ros.__file__)'"
    script = f'. install/setup.bash && command -v ivfmc && {where}'
    said = run(['bash', '-c', script], cwd=workspace)
    command, module = said.split()
    assert Path(command).is_relative_to(workspace)
    assert Path(module).is_relative_to(workspace)


@needs_colcon
def test_colcon_installs_what_ros_looks_for(workspace):
    share = workspace / 'install' / 'ivfmc_ros' / 'share'
    assert (share / 'ament_index/resource_index/packages/ivfmc_ros').is_file()
    assert {name for name in config_files() if not (share / 'ivfmc_ros' / name).is_file()} == set()
