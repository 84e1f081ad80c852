# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Reads a policy of SROS2: what each node is allowed, with full names."""

from collections.abc import Iterator
from pathlib import Path
from xml.etree import ElementTree

from support.graph_endpoints import Endpoint

_INCLUDE = '{http://www.w3.org/2001/XInclude}include'


def allowed(path: Path) -> dict[str, set[Endpoint]]:
    """Return the endpoints that a policy allows, by the path of the enclave."""
    found = {}
    for enclave in ElementTree.parse(path).getroot().iter('enclave'):
        [profile] = enclave.iter('profile')
        namespace, node = profile.attrib['ns'], profile.attrib['node']
        found[enclave.attrib['path']] = {
            (kind, _full(name, namespace, node)) for kind, name in _rules(profile, path.parent)
        }
    return found


def _rules(profile: ElementTree.Element, folder: Path) -> Iterator[Endpoint]:
    for element in profile:
        if element.tag == _INCLUDE:
            file = folder / element.attrib['href']
            yield from _rules(ElementTree.parse(file).getroot(), file.parent)
            continue
        for direction, rule in element.attrib.items():
            assert rule == 'ALLOW', f'{direction}={rule}'
            for name in element:
                yield (direction, name.tag), str(name.text)


def _full(name: str, namespace: str, node: str) -> str:
    if name.startswith('~'):
        return f'{namespace}/{node}{name[1:]}'
    return name if name.startswith('/') else f'{namespace}/{name}'
