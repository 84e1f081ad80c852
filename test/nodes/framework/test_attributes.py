# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""A node's attributes and those of rclpy.Node share one name space."""

import ast
import inspect
from pathlib import Path

import pytest
from support import house

node = pytest.importorskip('rclpy.node')


def attributes_set(tree: ast.AST) -> set[str]:
    """Names that are assigned to ``self`` anywhere in ``tree``."""
    return {
        target.attr
        for target in ast.walk(tree)
        if isinstance(target, ast.Attribute)
        and isinstance(target.ctx, ast.Store)
        and isinstance(target.value, ast.Name)
        and target.value.id == 'self'
    }


def node_classes(path: Path) -> list[ast.ClassDef]:
    """Classes of a file that are nodes, by the names of their bases."""
    classes = [item for item in house.parse(path).body if isinstance(item, ast.ClassDef)]
    return [
        item for item in classes if any(ast.unparse(base).endswith('Node') for base in item.bases)
    ]


def test_no_node_overwrites_an_attribute_of_rclpy():
    # such as _services or _subscriptions, without which a node does not start
    of_rclpy = attributes_set(ast.parse(inspect.getsource(node)))
    assert {'_services', '_subscriptions'} <= of_rclpy
    paths = sorted((house.ROOT / house.PACKAGE / 'nodes').rglob('*.py'))
    ours = {
        f'{path.stem}.{item.name}': attributes_set(item)
        for path in paths
        for item in node_classes(path)
    }
    assert len(ours) > 8
    assert {name: found & of_rclpy for name, found in ours.items() if found & of_rclpy} == {}
