# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""The tab with the earlier scans of the catalogue: result, report, mesh, and two compared."""

from collections.abc import Callable
from contextlib import closing
from html import escape
from pathlib import Path
from typing import Any

from ivfmc_ros.errors import ScanError
from ivfmc_ros.storage.catalogue.catalogue import Catalogue
from ivfmc_ros.storage.catalogue.rows import FoundScan
from ivfmc_ros.storage.catalogue.rows import ScanRow
from ivfmc_ros.storage.catalogue.search import ScanFilter
from ivfmc_ros.window.drawn import DrawnMesh
from ivfmc_ros.window.mesh_files import compare
from ivfmc_ros.window.mesh_files import load_mesh
from ivfmc_ros.window.placed_nominal import load_placed_nominal
from ivfmc_ros.window.placed_nominal import PlacedNominal

# Scans that are offered, the newest ones.
_NEWEST = 50
_NONE = '(none)'
# Of a file that is downloaded, which is read as a whole; bags of long scans are larger.
_MAX_BYTES = 200_000_000
_REPORTS = ('report.html', 'inspection.html')
_MESHES = ('mesh.ply', 'mesh.stl')


class HistoryTab:
    """Lists scans; only files of scans that the catalogue has are read."""

    def __init__(
        self,
        gui: Any,
        root: Path,
        show: Callable[[DrawnMesh], object],
    ) -> None:
        """
        Add the elements to the container that is open in ``gui``.

        root : folder of the scans
        show : draws a mesh
        """
        self._root, self._show = root, show
        self._found: dict[str, FoundScan] = {}
        self._scan = gui.add_dropdown('Scan', (_NONE,))
        self._other = gui.add_dropdown('Compare with', (_NONE,))
        refresh = gui.add_button('List again', icon='refresh')
        self._summary = gui.add_html('')
        draw = gui.add_button('Show mesh', icon='cube')
        report = gui.add_button('Download report', icon='file-text')
        self._file = gui.add_dropdown('File', (_NONE,))
        download = gui.add_button('Download file', icon='download')
        self._scan.on_update(lambda _: self._summarize())
        refresh.on_click(lambda _: self.refresh())
        draw.on_click(self._draw)
        report.on_click(self._send_reports)
        download.on_click(lambda event: self._send(event, str(self._file.value)))

    def refresh(self) -> None:
        """Read the catalogue again."""
        try:
            with closing(Catalogue(self._root)) as catalogue:
                found = catalogue.find(ScanFilter(newest=_NEWEST))
        except ScanError as error:
            # a cell that has not scanned yet has no catalogue
            self._summary.content = f'<small>{escape(str(error))}</small>'
            return
        self._found = {scan.scan_id: scan for scan in reversed(found)}
        names = (_NONE, *self._found)
        for dropdown in (self._scan, self._other):
            kept = dropdown.value
            dropdown.options = names
            dropdown.value = kept if kept in names else _NONE
        self._summarize()

    def _summarize(self) -> None:
        found = self._found.get(self._scan.value)
        self._file.options = self._files() or (_NONE,)
        if found is None:
            self._summary.content = f'<small>{len(self._found)} scans</small>'
            return
        rows = (
            ('part', found.part),
            ('recipe', found.recipe),
            ('time', found.created),
            ('result', found.code or found.stage),
            ('verdict', found.verdict),
            ('profiles', str(found.profiles)),
        )
        cells = ''.join(
            f'<tr><th scope="row" style="text-align:left">{name}</th><td>{escape(value)}</td></tr>'
            for name, value in rows
            if value
        )
        self._summary.content = f'<table aria-label="Scan">{cells}</table>'

    def _draw(self, event: Any) -> None:
        try:
            first, second = self._row(self._scan.value), self._row(self._other.value)
            path = _file(first, _MESHES)
            if first is None or path is None:
                _say(event, 'this scan has no mesh')
                return
            other = _file(second, _MESHES)
            if second is None or other is None:
                self._show(load_mesh(path, _unit(first), self._nominal(event, first.folder)))
            else:
                self._show(compare(path, _unit(first), other, _unit(second)))
        except ScanError as error:
            _say(event, str(error))

    def _nominal(self, event: Any, folder: Path) -> PlacedNominal | None:
        try:
            return load_placed_nominal(folder)
        except ScanError as error:
            # the mesh is shown all the same
            _say(event, f'without deviation: {error}')
            return None

    def _row(self, scan_id: str) -> ScanRow | None:
        """Return a scan that the catalogue has; its folder is no choice of the browser."""
        if scan_id not in self._found:
            return None
        with closing(Catalogue(self._root)) as catalogue:
            return catalogue.scan(scan_id)

    def _files(self) -> tuple[str, ...]:
        """Return the names of the files of the scan; empty without one."""
        try:
            row = self._row(self._scan.value)
            folder = None if row is None else row.folder
            found = [] if folder is None else sorted(folder.iterdir())
        except (ScanError, OSError):
            return ()
        return tuple(
            path.name for path in found if path.is_file() and not path.name.startswith('.')
        )

    def _send_reports(self, event: Any) -> None:
        names = [name for name in _REPORTS if name in self._files()]
        for name in names or _REPORTS[:1]:
            self._send(event, name)

    def _send(self, event: Any, name: str) -> None:
        # a browser may name any path
        path = None
        if name in self._files():
            try:
                path = _file(self._row(self._scan.value), (name,))
            except ScanError as error:
                _say(event, str(error))
                return
        if path is None:
            _say(event, 'this scan has no such file')
        elif path.stat().st_size > _MAX_BYTES:
            _say(event, f'{path.name} is too large for the page; it is in the folder of the scan')
        elif event.client is not None:
            event.client.send_file_download(f'{self._scan.value}_{path.name}', path.read_bytes())


def _file(row: ScanRow | None, names: tuple[str, ...]) -> Path | None:
    paths = () if row is None else (row.folder / name for name in names)
    return next((path for path in paths if path.is_file()), None)


def _unit(row: ScanRow) -> str:
    return str(row.parameters.get('export_unit', 'mm'))


def _say(event: Any, text: str) -> None:
    if event.client is not None:
        event.client.add_notification('History', text, color='red', auto_close_seconds=8.0)
