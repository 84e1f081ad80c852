# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Reads the launch files of config/, as far as tests need it."""

from pathlib import Path
import re
from xml.etree import ElementTree

from support.house import ROOT

CONFIG = ROOT / 'config'
_VARIABLE = re.compile(r'\$\(var ([^)]*)\)')


def launch_files() -> list[Path]:
    return sorted(CONFIG.glob('*.launch.xml'))


def load(path: Path) -> ElementTree.Element:
    return ElementTree.parse(path).getroot()


def arguments(root: ElementTree.Element) -> dict[str, str | None]:
    """Default of each declared argument; None for one that has to be given."""
    return {item.attrib['name']: item.get('default') for item in root.findall('arg')}


def used_arguments(root: ElementTree.Element) -> set[str]:
    texts = [value for item in root.iter() for value in item.attrib.values()]
    return {name for text in texts for name in _VARIABLE.findall(text)}


def remappings(name: str, kind: str = 'remap') -> dict[str, str]:
    """Remappings of a launch file by ``remap`` or ``set_remap``, with the default arguments."""
    root = load(CONFIG / name)
    defaults = arguments(root)

    def expanded(text: str) -> str:
        return _VARIABLE.sub(lambda found: defaults[found[1]] or '', text)

    return {expanded(item.attrib['from']): expanded(item.attrib['to']) for item in root.iter(kind)}


def included_file(include: ElementTree.Element) -> Path:
    """The file that an include of our own share folder names."""
    text = include.attrib['file']
    place = text.removeprefix('$(find-pkg-share ivfmc_ros)/')
    assert place != text, f'{text} is no file of this package'
    return ROOT / place
