# Copyright 2026 the ivfmc_ros authors
# SPDX-License-Identifier: Apache-2.0
"""
Clients of the work window that receive what a browser receives, and draw nothing.

They stand for browsers on other computers: what one costs the cell is what is sent to it.
"""

from collections.abc import Iterator
from contextlib import closing
from contextlib import contextmanager
from contextlib import ExitStack
from contextlib import suppress
import threading

import msgspec
import viser
from viser._messages import ViewerCameraMessage
from websockets.exceptions import ConnectionClosed
from websockets.sync.client import ClientConnection
from websockets.sync.client import connect

# The server counts a client from its first camera on.
_CAMERA = ViewerCameraMessage(
    wxyz=(1.0, 0.0, 0.0, 0.0),
    position=(22.0, -18.0, 16.0),
    fov=1.0,
    near=0.1,
    far=100.0,
    image_height=600,
    image_width=900,
    look_at=(0.0, 0.0, 3.0),
    up_direction=(0.0, 0.0, 1.0),
)


class PageClient:
    """
    One connection to a page, read in a thread of its own.

    received : bytes
    """

    def __init__(self, port: int) -> None:
        self.received = 0
        self._socket: ClientConnection = connect(
            f'ws://127.0.0.1:{port}',
            subprotocols=[f'viser-v{viser.__version__}'],  # type: ignore[list-item]
            max_size=None,
        )
        self._socket.send(msgspec.msgpack.encode(_CAMERA.as_serializable_dict()))
        self._thread = threading.Thread(target=self._receive, daemon=True)
        self._thread.start()

    def _receive(self) -> None:
        with suppress(ConnectionClosed):
            for message in self._socket:
                self.received += len(message)

    def close(self) -> None:
        """End the connection."""
        self._socket.close()
        self._thread.join(5.0)


@contextmanager
def page_clients(port: int, count: int) -> Iterator[list[PageClient]]:
    """Yield so many clients of the page at a port of this computer."""
    with ExitStack() as stack:
        yield [stack.enter_context(closing(PageClient(port))) for _ in range(count)]
