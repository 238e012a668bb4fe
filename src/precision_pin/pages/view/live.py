"""A page that follows its files: served on this machine alone, rebuilt and reloaded when one of them changes.

The browser shows an outer document whose single frame holds the page, so that the page keeps its own strict policy and
needs no script for this. The outer document asks twice a second for the page's version, a digest, and reloads the frame
when it differs, with the sliders and the view as the reader left them.
"""

from __future__ import annotations

import hashlib
import os
import socket
import socketserver
import sys
import threading
import time
import webbrowser
from collections.abc import Callable, Sequence
from contextlib import suppress
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler
from pathlib import Path
from stat import S_ISREG
from string import Template
from typing import Any, Final

from precision_pin.base.errors import InputError, OutputError
from precision_pin.pages.view.page import asset, source_hash
from precision_pin.render.html import escaped

_HOST: Final = "127.0.0.1"
_PORTS: Final = range(1024, 65536)
_ALLOWED_PORTS: Final = f"give 0 for any free port, or one of {_PORTS[0]} to {_PORTS[-1]}"


def serve(
    make_page: Callable[[], str],
    watched: Sequence[Path] = (),
    *,
    port: int = 0,
    open_browser: bool = True,
    announce: Callable[[str], None],
    tick: Callable[[], None] = lambda: None,
) -> None:
    """Serve a page on 127.0.0.1 until Ctrl-C, and rebuild it whenever a watched file changes.

    Only this machine can reach the page, but every user of it can. Errors in the files are shown instead of the page.

    Args:
        make_page: Returns the page, HTML. It is called in this thread, the first time before anything is served.
        watched: Files whose contents matter, including ones that are replaced, removed or do not exist yet.
        port: 0 for any free one, or 1024 to 65535.
        open_browser: Open the reader's browser, if there is one that can show the page.
        announce: Receives the lines for the reader: the address, changes, errors.
        tick: Called several times a second; it may raise KeyboardInterrupt, which ends the serving as Ctrl-C does.
    """
    if isinstance(port, bool) or not isinstance(port, int) or not (port == 0 or port in _PORTS):
        raise InputError(f"there is no port {port!r} to serve on; {_ALLOWED_PORTS}")
    watch = _Watch(watched)
    try:
        server = _Server(port)
    except OSError as problem:
        raise OutputError(f"cannot serve on port {port}: {problem.strerror or problem}; {_ALLOWED_PORTS}") from None
    with server:
        server.content = _content_of(make_page())

        def step() -> None:
            tick()
            if watch.changed():
                try:
                    server.content = _content_of(make_page())
                    announce("the files have changed; the page was rebuilt")
                except InputError as error:
                    announce(str(error))
                    findings = "".join(f"<li>{escaped(str(finding))}</li>" for finding in error.findings)
                    files = ", ".join(f"<code>{escaped(str(path))}</code>" for path in watched)
                    server.content = _content_of(_PROBLEM.substitute(findings=findings, watched=files))

        server.step = step
        with suppress(KeyboardInterrupt):
            announce(server.address)
            if open_browser:
                # some browsers return only when they are closed
                threading.Thread(target=_open, args=(server.address,), daemon=True).start()
            server.serve_forever(poll_interval=0.1)


def _content_of(text: str) -> tuple[bytes, bytes]:
    """Return the page in the frame, and its digest."""
    body = text.encode("utf-8")
    return body, hashlib.sha256(body).hexdigest().encode("ascii")


def _open(address: str) -> None:
    with suppress(webbrowser.Error, OSError):
        browser = webbrowser.get()
        # these browsers take over the terminal and cannot draw the scene
        if os.path.basename(getattr(browser, "name", "")) not in ("www-browser", "links", "elinks", "lynx", "w3m"):
            browser.open(address)


class _Watch:
    """Files, and their contents when the page was last built."""

    def __init__(self, paths: Sequence[Path]) -> None:
        self._paths = tuple(paths)
        self._read: dict[Path, tuple[tuple[int, ...], bytes]] = {}
        self._made_from = self._latest = self._look()
        self._next = 0.0

    def changed(self) -> bool:
        """Return whether the page should be rebuilt; checks the files at most four times a second."""
        if time.monotonic() < self._next:
            return False
        before, self._latest = self._latest, self._look()
        # from its end: two looks at once, after the machine held one up, would find any half alike
        self._next = time.monotonic() + 0.25
        # unchanged twice: nobody is in the middle of writing
        if self._latest != before or self._latest == self._made_from:
            return False
        self._made_from = self._latest
        return True

    def _look(self) -> tuple[bytes | None, ...]:
        return tuple(self._digest(path) for path in self._paths)

    def _digest(self, path: Path) -> bytes | None:
        """Return the digest of a file, None if it cannot be read; an unchanged large file is not read again."""
        try:
            now = path.stat()
            if not S_ISREG(now.st_mode):
                return None
            stamp = (now.st_ino, now.st_size, now.st_mtime_ns, now.st_ctime_ns)
            known = self._read.get(path)
            if known is not None and known[0] == stamp:
                return known[1]
            # a file system may give two writes within 2 s the same stamp
            recent = abs(time.time_ns() - max(now.st_mtime_ns, now.st_ctime_ns)) < 2_000_000_000
            with path.open("rb") as stream:
                digest = hashlib.file_digest(stream, "sha256").digest()
        except OSError:
            return None
        if not recent:
            self._read[path] = stamp, digest
        return digest


class _Server(socketserver.ThreadingMixIn, socketserver.TCPServer):
    """Server with a thread for each connection; all of them end with the server."""

    allow_reuse_address = True  # of a server that has just ended
    request_queue_size = 64  # a page being made keeps requests waiting

    def __init__(self, port: int) -> None:
        self.content = _content_of("")
        self.step: Callable[[], None] = lambda: None
        self._connections: set[Any] = set()
        super().__init__((_HOST, port), _Handler)
        self.port: int = self.socket.getsockname()[1]
        self.address = f"http://{_HOST}:{self.port}/"

    def service_actions(self) -> None:
        self.step()

    def process_request(self, request: Any, client_address: Any) -> None:
        self._connections.add(request)
        super().process_request(request, client_address)

    def shutdown_request(self, request: Any) -> None:
        self._connections.discard(request)
        super().shutdown_request(request)

    def server_close(self) -> None:
        # browsers keep idle connections open, whose threads would block the shutdown
        for connection in tuple(self._connections):
            with suppress(OSError):
                connection.shutdown(socket.SHUT_RDWR)
        super().server_close()

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Log nothing about readers who left."""
        if not isinstance(sys.exception(), OSError):
            super().handle_error(request, client_address)


class _Handler(BaseHTTPRequestHandler):
    """Serves the outer document, the page and its version; refuses everything else."""

    server: _Server
    timeout = 10.0  # s, of a silent connection
    server_version = "precision-pin"
    sys_version = ""
    error_message_format = "%(code)d %(message)s\n"
    error_content_type = "text/plain; charset=utf-8"

    def do_GET(self) -> None:
        # a foreign name that resolves to this machine (DNS rebinding) shows in Host
        hosts = [host.lower() for host in self.headers.get_all("Host", [])]
        if hosts not in ([f"{_HOST}:{self.server.port}"], [f"localhost:{self.server.port}"]):
            self.send_error(HTTPStatus.FORBIDDEN, f"open {self.server.address}")
            return
        body, version = self.server.content
        match self.path.partition("?")[0]:
            case "/":
                self._send(_OUTER.encode("utf-8"), "text/html", _OUTER_POLICY)
            case "/page":
                self._send(body, "text/html", "frame-ancestors 'self'")
            case "/version":
                self._send(version, "text/plain", "frame-ancestors 'none'")
            case _:
                self.send_error(HTTPStatus.NOT_FOUND)

    do_HEAD = do_GET

    def _send(self, body: bytes, kind: str, policy: str) -> None:
        self.send_response(HTTPStatus.OK)
        self.send_header("Content-Type", f"{kind}; charset=utf-8")
        self.send_header("Content-Length", str(len(body)))
        self.send_header("Content-Security-Policy", policy)
        self.end_headers()
        if self.command != "HEAD":
            self.wfile.write(body)

    def end_headers(self) -> None:
        self.send_header("Cache-Control", "no-store")
        self.send_header("X-Content-Type-Options", "nosniff")
        self.send_header("Referrer-Policy", "no-referrer")
        self.send_header("Cross-Origin-Resource-Policy", "same-origin")
        super().end_headers()

    def log_message(self, format: str, *args: object) -> None:
        """Log nothing about requests."""


_STYLE: Final = asset("live.css")
_SCRIPT: Final = asset("live.js")
_OUTER: Final = Template(asset("live.html")).substitute(style=_STYLE, script=_SCRIPT)
_OUTER_POLICY: Final = (
    f"default-src 'none'; script-src {source_hash(_SCRIPT)}; style-src {source_hash(_STYLE)}; img-src data:; connect-src 'self'; "
    "frame-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)

_PROBLEM: Final = Template(asset("problem.html"))
