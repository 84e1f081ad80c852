# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Command groups that suggest the command that a mistyped name may mean."""

import difflib

import click


class SuggestingGroup(click.Group):
    """A group whose error for an unknown command names similar ones."""

    def resolve_command(
        self, ctx: click.Context, args: list[str]
    ) -> tuple[str | None, click.Command | None, list[str]]:
        """Find the command; :raises click.UsageError: there is none, with similar names."""
        known = self.list_commands(ctx)
        if args and self.get_command(ctx, args[0]) is None and not args[0].startswith('-'):
            similar = difflib.get_close_matches(args[0], known, n=2)
            hint = f' Did you mean {" or ".join(similar)}?' if similar else ''
            ctx.fail(f'No such command {args[0]!r}.{hint} Commands: {", ".join(known)}.')
        return super().resolve_command(ctx, args)
