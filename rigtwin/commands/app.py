"""``rigtwin app``: the diagnosis as a page in the browser."""

from __future__ import annotations

import webbrowser
from importlib.util import find_spec

from rigtwin.console import say
from rigtwin.errors import UserError


def run_app(port: int, *, browser: bool) -> None:
    """Serve the app until it is interrupted."""
    if find_spec("dash") is None:
        raise UserError("rigtwin app needs Dash, which is not installed; install it with pip install 'rigtwin[app]'")
    from rigtwin.app.server import AppServer

    server = AppServer(port)
    say(f"rigtwin app at {server.address}, on this machine alone; Ctrl-C ends it")
    if browser:
        webbrowser.open(server.address)
    server.serve()
