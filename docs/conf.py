# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Settings of Sphinx for the documentation of ivfmc_ros; ``make docs`` builds it."""

from pathlib import Path
import sys

ROOT = Path(__file__).resolve().parents[1]
sys.path[:0] = [str(ROOT), str(ROOT / 'docs' / '_ext')]

from ivfmc_ros import __version__  # noqa: E402 - found by the lines above

project = 'ivfmc_ros'
author = 'the ivfmc_ros authors'
project_copyright = '2026, the ivfmc_ros authors'
version = release = __version__

extensions = [
    'myst_parser',
    'sphinx.ext.apidoc',
    'sphinx.ext.autodoc',
    'sphinx.ext.mathjax',
    'sphinx_click',
    'sphinx_copybutton',
    'plain_docstrings',
]
exclude_patterns = ['_build', 'reference/api/modules.rst']
myst_enable_extensions = ['colon_fence', 'deflist', 'dollarmath', 'fieldlist']
myst_heading_anchors = 3

apidoc_modules = [
    {
        'path': '../ivfmc_ros',
        'destination': 'reference/api',
        'separate_modules': False,
        'module_first': True,
        'max_depth': 2,
        'automodule_options': {'members', 'show-inheritance', 'ignore-module-all'},
        'exclude_patterns': ['../ivfmc_ros/nodes/**', '../ivfmc_ros/cli/**'],
    }
]
autodoc_default_options = {
    'members': True,
    'show-inheritance': True,
    # what a package re-exports is documented where it is defined
    'ignore-module-all': True,
}
autodoc_member_order = 'bysource'
autodoc_typehints = 'signature'
autodoc_class_signature = 'separated'

html_theme = 'furo'
html_title = 'ivfmc_ros'
html_theme_options = {'navigation_with_keys': True}
# pages open from the disk, without a network
html_math_renderer = 'mathjax'
copybutton_exclude = '.linenos, .gp, .go'
