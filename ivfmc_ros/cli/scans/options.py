# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""Options of ``ivfmc scans``: which catalogue, and which scans of it."""

from collections.abc import Callable
from datetime import datetime
from datetime import timedelta
from datetime import UTC
from pathlib import Path
import re
from typing import Any
from typing import TYPE_CHECKING
from typing import TypeVar

import click

from ivfmc_ros.cli.support.source import scans_option
from ivfmc_ros.storage.catalogue.catalogue import Catalogue
from ivfmc_ros.storage.catalogue.database import URL_VARIABLE
from ivfmc_ros.storage.catalogue.search import ScanFilter

if TYPE_CHECKING:
    _ParamType = click.ParamType[str]
else:
    _ParamType = click.ParamType

Command = TypeVar('Command', bound=Callable[..., Any])

_AGO = re.compile(r'(\d+)\s*(min|h|d|w)')
_UNITS = {'min': 'minutes', 'h': 'hours', 'd': 'days', 'w': 'weeks'}


class Time(_ParamType):
    """A date or time in ISO 8601 (UTC without an offset), 'today', or a time ago such as 7d."""

    name = 'time'

    def convert(self, value: Any, param: click.Parameter | None, ctx: click.Context | None) -> str:
        """Return it as the catalogue stores times."""
        now = datetime.now(UTC)
        ago = _AGO.fullmatch(str(value).strip())
        if ago:
            moment = now - timedelta(**{_UNITS[ago.group(2)]: int(ago.group(1))})
        elif value == 'today':
            moment = now.replace(hour=0, minute=0, second=0, microsecond=0)
        else:
            try:
                moment = datetime.fromisoformat(str(value))
            except ValueError:
                self.fail(
                    f'{value!r} is neither a date such as 2026-11-27, nor today, nor a time ago '
                    'such as 30min, 12h, 7d, 2w',
                    param,
                    ctx,
                )
            moment = moment.replace(tzinfo=moment.tzinfo or UTC).astimezone(UTC)
        return moment.isoformat(timespec='milliseconds').replace('+00:00', 'Z')


url_option = click.option(
    '--catalogue',
    'url',
    metavar='URL',
    envvar=URL_VARIABLE,
    default='',
    help='Database of a plant, postgresql+psycopg://USER@HOST/DATABASE.  [default: '
    'catalogue.sqlite3 in the folder of the scans]',
)
_FILTERS = (
    click.option('--part', default='', help='Only scans of this part.'),
    click.option('--recipe', default='', help='Only scans of this recipe.'),
    click.option('--cell', default='', help='Only scans of this cell.'),
    click.option('--code', default='', help='Only scans that ended with this code, such as OK.'),
    click.option('--verdict', default='',
                 help='Only scans whose last inspection has this verdict: pass, fail, ...'),
    click.option('--calibration', default='', metavar='SHA256',
                 help='Only scans taken with this cell.yaml; the first digits, as show prints '
                 'them, are enough.'),
    click.option('--since', type=Time(), default=None,
                 help='Only scans from then on: a date, today, or a time ago such as 7d.'),
    click.option('--until', type=Time(), default=None, help='Only scans before then.'),
    click.option('--feature', default='',
                 help='Only scans that measured this feature, with its values, such as "hole 3".'),
    click.option('--characteristic', default='',
                 help='Of the feature: diameter, position, ...'),
)  # fmt: skip


def catalogue_options(command: Command) -> Command:
    """Add the options ``root`` and ``url`` of a command that opens the catalogue."""
    return scans_option(url_option(command))


def filter_options(command: Command) -> Command:
    """Add the options from which ``filter_of`` makes a filter."""
    for option in reversed(_FILTERS):
        command = option(command)
    return command


def filter_of(options: dict[str, Any], **more: Any) -> ScanFilter:
    """Return the filter that options ask for."""
    values: dict[str, Any] = {name: value or '' for name, value in options.items()}
    return ScanFilter(**values, **more)


def open_catalogue(
    root: Path, url: str, *, create: bool = False, cell: str | None = None
) -> Catalogue:
    """:raises CatalogueError: there is no catalogue, or it cannot be read."""
    return Catalogue(root, url=url, create=create, cell=cell)
