"""Local web server of the explorer, which serves only its own page.

It listens on 127.0.0.1. Each request must name this host, have the origin of the page if it states an origin, and
contain the token of this run, which is printed in the terminal.
"""

from __future__ import annotations

import base64
import errno
import os
import secrets
import socket
from collections.abc import Callable
from functools import partial
from typing import Any

from hbgear.common.optional import needed
from hbgear.continuation.solvers.newton import NoConvergence
from hbgear.io.branches.archive import too_deep
from hbgear.web.explorer import Explorer, Request, Superseded
from hbgear.web.page import page, plotly_script

HOST = "127.0.0.1"
_MAX_REQUEST_BYTES = 8_000_000
"""Largest size of a request [bytes]."""

_CONNECTION_TIMEOUT = 20.0
"""Time [s] after which a silent connection is closed, so that it does not occupy a thread."""

_CONTENT = (
    "default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; img-src data: blob:; "
    "connect-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)


Answer = Callable[[dict[str, Any], str, Request], Any]
"""Function that answers a request: of the JSON of a page, its session, and the request."""


def _protect(flask: Any, app: Any, token: str, hosts: Callable[[], set[str]]) -> None:
    """Let an application refuse requests that are not of its own page, and add the headers of security."""

    @app.before_request
    def guard() -> Any:
        """Refuse requests to other hosts, from other pages, and without the token."""
        accepted = hosts()
        origin = flask.request.headers.get("Origin")
        sent_token = flask.request.headers.get("X-Hbgear-Token") or flask.request.args.get("token", "")
        if flask.request.host not in accepted:
            return "this host is not served here", 403
        if origin is not None and origin not in {f"http://{host}" for host in accepted}:
            return "requests from other pages are refused", 403
        if flask.request.headers.get("Sec-Fetch-Site", "none") not in ("same-origin", "none"):
            return "requests from other pages are refused", 403
        if not secrets.compare_digest(sent_token.encode(), token.encode()):
            return "the token is missing or of another run; open the address that hbgear explore printed", 403
        return None

    @app.after_request
    def closed(response: Any) -> Any:
        response.headers["Content-Security-Policy"] = _CONTENT
        response.headers["Referrer-Policy"] = "no-referrer"
        response.headers["X-Content-Type-Options"] = "nosniff"
        response.headers["Cache-Control"] = "no-store"
        return response

    @app.errorhandler(RecursionError)
    def nested(error: RecursionError) -> Any:
        return flask.jsonify(error="the request is nested too deeply"), 400


def _answers(flask: Any, explorer: Explorer) -> dict[str, Answer]:
    """Return the functions that answer requests, by path."""

    def measured(body: dict[str, Any], session: str, query: Request) -> Any:
        return explorer.measured(query, _bytes(body.get("content")), str(body.get("name", "points"))[:80])

    def file(body: dict[str, Any], session: str, query: Request) -> Any:
        name, content = explorer.saved_as(session, body["kind"], query)
        return flask.Response(content, mimetype="application/octet-stream", headers={"X-Name": name})

    return {
        "/curve": lambda body, session, query: explorer.curve(session, query),
        "/details": lambda body, session, query: explorer.details(session, query),
        "/map": lambda body, session, query: explorer.jump_map(session, query, body.get("axes")),
        "/measured": measured,
        "/save/<kind>": file,
    }


def application(explorer: Explorer, title: str, token: str, hosts: Callable[[], set[str]]) -> Any:
    """Return the Flask application of an explorer; ValueError if Flask is not installed.

    Each request must contain the token, as the parameter ``token`` or in the header X-Hbgear-Token. ``hosts`` returns
    the accepted host names with port.
    """
    flask = needed("flask", "explore", "the explorer")
    app = flask.Flask("hbgear", static_folder=None)
    app.config["MAX_CONTENT_LENGTH"] = _MAX_REQUEST_BYTES
    app.json.sort_keys = False
    request = flask.request

    _protect(flask, app, token, hosts)

    def sent() -> Any:
        """Return the JSON of the request; None if it is invalid."""
        body = request.get_json(silent=True)
        if too_deep(body):
            raise RecursionError
        return body

    def answered(answer: Answer, **route: str) -> Any:
        """Return the result, an empty response if the computation was superseded, or an error message."""
        body = sent()
        try:
            if not isinstance(body, dict):
                raise ValueError("the request must be a JSON object")
            return answer({**body, **route}, str(body.get("session", ""))[:64], Request.of(body))
        except Superseded:
            return "", 204  # not an error status: browsers would log it for each move of a slider
        except (ValueError, KeyError, NoConvergence, ArithmeticError) as error:
            text = error.args[0] if isinstance(error, KeyError) and error.args else error
            return flask.jsonify(error=str(text))  # no error status, for the same reason: the page shows the sentence

    for path, answer in _answers(flask, explorer).items():
        app.add_url_rule(path, path, partial(answered, answer), methods=["POST"])

    @app.get("/")
    def start_page() -> Any:
        return page("explorer.html", explorer.start(), "'self'", title=title, token=token, plotly=plotly_script())

    @app.get("/progress")
    def progress() -> Any:
        return explorer.progress(request.args.get("session", ""), request.args.get("kind", ""))

    @app.post("/cancel")
    def cancel() -> Any:
        body = sent()
        if isinstance(body, dict):
            explorer.cancel(str(body.get("session", "")), str(body.get("kind", "")))
        return {}

    return app


def _bytes(content: Any) -> bytes:
    """Return the bytes of a file that a page sent in base64."""
    try:
        return base64.b64decode(content, validate=True)
    except (TypeError, ValueError):
        raise ValueError("the content of a file must be base64") from None


class Server:
    """A web server of an explorer.

    Parameters
    ----------
    explorer : Explorer
        Computations of the pages.
    title : str
        Title of the page.
    port : int, optional
        Port; default 0, any free port.
    patience : float, optional
        Time [s] after which a silent connection is closed; default 20.

    Raises
    ------
    ValueError
        If Flask is not installed, or the port is taken or not allowed.
    """

    def __init__(self, explorer: Explorer, title: str, port: int = 0, patience: float = _CONNECTION_TIMEOUT) -> None:
        serving = needed("werkzeug.serving", "explore", "the explorer")
        self.explorer, self.token = explorer, secrets.token_urlsafe(24)
        app = application(explorer, title, self.token, self._hosts)

        class QuietHandler(serving.WSGIRequestHandler):  # type: ignore[name-defined,misc]
            """Handler without a log of requests, because their addresses contain the token."""

            protocol_version = "HTTP/1.1"
            timeout = patience  # of each read and write; otherwise a silent connection occupies its thread

            def log(self, type: str, message: str, *args: Any) -> None:
                pass

        try:
            listener = _listening(port)
            self.port = int(listener.getsockname()[1])
            self._server = serving.make_server(
                HOST, self.port, app, threaded=True, request_handler=QuietHandler, fd=listener.fileno()
            )
            listener.close()  # the server has a duplicate
        except OSError as error:
            in_use = error.errno == errno.EADDRINUSE
            reason = "is taken by another program" if in_use else f"cannot be used ({error.strerror})"
            raise ValueError(f"port {port} {reason}; give another by --port, or none for any that is free") from None
        self._server.daemon_threads = True

    def _hosts(self) -> set[str]:
        return {f"{HOST}:{self.port}", f"localhost:{self.port}"}

    @property
    def address(self) -> str:
        """Address of the page, with the token."""
        return f"http://{HOST}:{self.port}/?token={self.token}"

    def run(self) -> None:
        """Serve requests until Ctrl-C, which also cancels running computations."""
        try:
            self._server.serve_forever(poll_interval=0.2)
        finally:
            self.explorer.cancel()
            self._server.server_close()


def _listening(port: int) -> Any:
    """Return a socket that listens at a port."""
    listener = socket.socket(socket.AF_INET, socket.SOCK_STREAM)
    if os.name == "posix":  # reuse a recently closed port; other systems would share the port
        listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind((HOST, port))
        listener.listen(64)
    except (OSError, OverflowError):
        listener.close()
        raise
    return listener
