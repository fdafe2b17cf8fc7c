"""Who may ask the app, where it listens, and how it ends."""

from __future__ import annotations

import logging
import os
import socket
from collections.abc import Sequence
from socketserver import BaseServer

from flask import abort, request
from werkzeug.serving import WSGIRequestHandler, make_server

from rigtwin.app.job import WORKER
from rigtwin.app.view import Bench, make_app
from rigtwin.errors import UserError

HOST = "127.0.0.1"  # this machine alone: the app reads files and has no password

# What every answer says: no other page may show this one in a frame, and no type is guessed.
_HEADERS = {"X-Frame-Options": "SAMEORIGIN", "X-Content-Type-Options": "nosniff", "Cache-Control": "no-store"}


class AppServer:
    """The app on a port of this machine.

    Parameters
    ----------
    port : where it listens; 0 for any that is free
    worker : the command that diagnoses a campaign

    Raises
    ------
    UserError : the port is in use, or not for this user
    """

    def __init__(self, port: int, worker: Sequence[str] = WORKER):
        logging.getLogger("werkzeug").setLevel(logging.WARNING)  # a line for each request is of no use
        self._bench = Bench(worker)
        app = make_app(self._bench)
        with self._listening(port) as listening:
            self.port = listening.getsockname()[1]
            self._server = make_server(
                HOST, self.port, app.server, threaded=True, request_handler=_Quiet, fd=listening.fileno()
            )
        names = {f"{host}:{self.port}" for host in (HOST, "localhost")}
        app.server.before_request(lambda: _refuse_others(names))
        app.server.after_request(lambda answer: (answer.headers.update(_HEADERS), answer)[1])

    @property
    def address(self) -> str:
        """What a browser asks for."""
        return f"http://{HOST}:{self.port}"

    @property
    def worker_pid(self) -> int | None:
        """Of the process that diagnoses, if there was one."""
        return self._bench.job.pid if self._bench.job else None

    def _listening(self, port: int) -> socket.socket:
        try:
            return socket.create_server((HOST, port))
        except OSError as error:
            self._bench.close()
            raise UserError(
                f"port {port} of {HOST} cannot be used ({os.strerror(error.errno or 0)}); give another one with --port"
            ) from error

    def serve(self) -> None:
        """Answer until the process is interrupted, or until ``stop``."""
        try:
            BaseServer.serve_forever(self._server)  # werkzeug's own takes an interrupt for its end
        finally:
            self._server.server_close()
            self._bench.close()

    def stop(self) -> None:
        """End ``serve``, which runs in another thread."""
        self._server.shutdown()


class _Quiet(WSGIRequestHandler):
    """Says nothing of its version."""

    def version_string(self) -> str:
        return "rigtwin"


def _refuse_others(names: set[str]) -> None:
    """Pages of other sites get no answer, not even by a name of theirs that leads to this machine."""
    origin = request.headers.get("Origin")
    if request.host not in names or (origin is not None and origin.removeprefix("http://") not in names):
        abort(403)
