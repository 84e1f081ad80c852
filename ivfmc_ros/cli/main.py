# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""``ivfmc``: one command for people without a ROS workspace, and for batch work."""

from collections.abc import Sequence
from importlib import import_module
import sys

import click

from ivfmc_ros import __version__
from ivfmc_ros.cli.support.suggest import SuggestingGroup
from ivfmc_ros.errors import ScanError

# Loaded when called, so that 'ivfmc --help' does not wait for open3d.
_COMMANDS = {
    'calibrate': 'ivfmc_ros.cli.calibrate:calibrate',
    'demo': 'ivfmc_ros.cli.demo:demo',
    'gateway': 'ivfmc_ros.cli.gateway:gateway',
    'merge': 'ivfmc_ros.cli.merge:merge',
    'recipes': 'ivfmc_ros.cli.recipes:recipes',
    'replay': 'ivfmc_ros.cli.replay:replay',
    'scan': 'ivfmc_ros.cli.scan:scan',
    'scans': 'ivfmc_ros.cli.scans:scans',
    'up': 'ivfmc_ros.cli.up:up',
    'import-images': 'ivfmc_ros.cli.import_images:import_images',
    'inspect': 'ivfmc_ros.cli.inspect:inspect',
    'reconstruct': 'ivfmc_ros.cli.reconstruct:reconstruct',
    'view': 'ivfmc_ros.cli.view:view',
}


class _LazyGroup(SuggestingGroup):
    def list_commands(self, ctx: click.Context) -> list[str]:
        return sorted(_COMMANDS)

    def get_command(self, ctx: click.Context, cmd_name: str) -> click.Command | None:
        if cmd_name not in _COMMANDS:
            return None
        module, name = _COMMANDS[cmd_name].split(':')
        command = getattr(import_module(module), name)
        return command if isinstance(command, click.Command) else None


@click.group(cls=_LazyGroup, context_settings={'help_option_names': ['-h', '--help']})
@click.version_option(__version__, prog_name='ivfmc')
def ivfmc() -> None:
    """Laser-stripe turntable scanner: calibrate, scan, reconstruct, inspect."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command; what a user can cause ends in one line and exit code 1."""
    try:
        ivfmc(args=arguments, prog_name='ivfmc')
    except ScanError as error:
        click.echo(f'ivfmc: error: {error}', err=True)
        sys.exit(1)


if __name__ == '__main__':
    main()
