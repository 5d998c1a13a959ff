"""Web server of a live view: on loopback alone, for a page that knows its token.

The page can ask for plans; it cannot read or write files, but for the one that the command line
names. A request is answered only if its Host is this computer's loopback (other pages could point
a name of theirs to 127.0.0.1), and a POST only with the token, which other pages do not know.
"""

from __future__ import annotations

import json
import secrets
from collections.abc import Callable, Mapping
from hmac import compare_digest
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any, NoReturn
from urllib.parse import parse_qs, urlsplit

from zmp_sqp.errors import ScenarioError, ZmpSqpError
from zmp_sqp.view.desk import Superseded
from zmp_sqp.view.page import live_page
from zmp_sqp.view.session import Session

__all__ = ["LARGEST", "TOKEN", "ViewServer"]

LOOPBACK = "127.0.0.1"
NAMES = (LOOPBACK, "localhost")
TOKEN = "X-Zmp-Sqp-Token"  # header of a POST
LARGEST = 1 << 16  # [bytes] of a request's body
IDLE = 60.0  # [s] after which a silent connection is closed
PATIENCE = 5.0  # [s] for the work in progress when the view ends
POLICY = (
    "default-src 'none'; script-src 'nonce-{nonce}'; style-src 'nonce-{nonce}'; "
    "img-src data: blob:; connect-src 'self'; base-uri 'none'; form-action 'none'; "
    "frame-ancestors 'none'"
)
HEADERS = {
    "Cache-Control": "no-store",
    "Referrer-Policy": "no-referrer",  # the token is in the address
    "X-Content-Type-Options": "nosniff",
    "X-Frame-Options": "DENY",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
}


class Refused(Exception):
    """A request that is answered with an error status and a sentence."""

    def __init__(self, status: HTTPStatus, sentence: str) -> None:
        super().__init__(sentence)
        self.status, self.sentence = status, sentence


class ViewServer(ThreadingHTTPServer):
    """Server of one session.

    Attributes:
        session: The session.
        token: Secret that requests must have.
        save_to: File to which the page may save the scenario; None lets it download only.
    """

    daemon_threads = True
    block_on_close = False

    def __init__(self, session: Session, *, port: int = 0, save_to: Path | None = None) -> None:
        """Listen on a port of 127.0.0.1; 0 takes a free one. Raises OSError if it is taken."""
        self.session = session
        self.token = secrets.token_urlsafe(24)
        self.save_to = save_to
        super().__init__((LOOPBACK, port), Handler)

    @property
    def url(self) -> str:
        """Address of the page, with the token."""
        return f"http://{LOOPBACK}:{self.server_port}/?token={self.token}"

    def hosts(self) -> set[str]:
        """Host headers that are answered."""
        return {f"{name}{port}" for name in NAMES for port in ("", f":{self.server_port}")}

    def handle_error(self, request: Any, client_address: Any) -> None:
        """Say nothing about a connection that the browser has closed."""

    def server_close(self) -> None:
        """Stop listening, drop what waits, and let the work in progress end."""
        super().server_close()
        self.session.desk.close(PATIENCE)


class Handler(BaseHTTPRequestHandler):
    """Answers to one connection."""

    server: ViewServer
    protocol_version = "HTTP/1.1"
    server_version = "zmp-sqp"
    sys_version = ""
    timeout = IDLE

    def do_GET(self) -> None:
        """Send the page."""
        self._answer(self._get)

    def do_POST(self) -> None:
        """Answer a request of the page."""
        self._answer(self._post)

    def log_message(self, format: str, *args: Any) -> None:
        """Print nothing: the terminal belongs to the command."""

    def _answer(self, work: Callable[[], None]) -> None:
        """Do the work; what is refused gets a status and a sentence as JSON."""
        try:
            work()
        except Refused as fault:
            self.close_connection = True  # a body may be left unread
            self._send(fault.status, {"error": fault.sentence})
        except ZmpSqpError as fault:
            self._send(HTTPStatus.BAD_REQUEST, {"error": str(fault)})
        except Superseded:
            self._send(HTTPStatus.OK, {"state": "superseded"})
        except (ConnectionError, TimeoutError):
            self.close_connection = True
        except Exception as fault:  # the page must hear of it, or it would wait
            self.close_connection = True
            words = f"the planner failed ({type(fault).__name__}: {fault}); nothing is certified"
            self._send(HTTPStatus.INTERNAL_SERVER_ERROR, {"error": words})

    def _get(self) -> None:
        self._check_host()
        address = urlsplit(self.path)
        if address.path != "/":
            raise Refused(HTTPStatus.NOT_FOUND, "there is only one page, at /")
        given = parse_qs(address.query).get("token", [""])[0]
        if not self._is_token(given):
            _forbid("open the address that `zmp-sqp view` printed, with its token")
        nonce = secrets.token_urlsafe(16)
        server = self.server
        page = live_page(server.session, server.token, nonce, server.save_to)
        self._send_text(
            HTTPStatus.OK,
            page,
            "text/html; charset=utf-8",
            {"Content-Security-Policy": POLICY.format(nonce=nonce)},
        )

    def _post(self) -> None:
        self._check_host()
        origin = self.headers.get("Origin")
        if origin is not None and origin not in {f"http://{host}" for host in self.server.hosts()}:
            _forbid("requests of other pages are not answered")
        if not self._is_token(self.headers.get(TOKEN, "")):
            _forbid("the token is missing or wrong: open the page anew")
        body = self._body()
        work = {
            "/plan": self._plan,
            "/rest": self._rest,
            "/advice": self._advice,
            "/text": self._text,
            "/save": self._save,
        }
        path = urlsplit(self.path).path
        if path not in work:
            raise Refused(
                HTTPStatus.NOT_FOUND, f"there is no {path[:40]}; there is {', '.join(work)}"
            )
        self._send(HTTPStatus.OK, work[path](body))

    def _plan(self, body: Mapping[str, Any]) -> dict[str, Any]:
        return self.server.session.plan(body.get("values", {}), settle=_flag(body, "settle"))

    def _rest(self, body: Mapping[str, Any]) -> dict[str, Any]:
        return self.server.session.rest(body.get("values", {}), tables=_flag(body, "tables"))

    def _advice(self, body: Mapping[str, Any]) -> dict[str, Any]:
        return self.server.session.advice(body.get("values", {}))

    def _text(self, body: Mapping[str, Any]) -> dict[str, Any]:
        return {"text": self.server.session.text(body.get("values", {}), None)}

    def _save(self, body: Mapping[str, Any]) -> dict[str, Any]:
        target = self.server.save_to
        if target is None:
            raise ScenarioError("no file was named: start `zmp-sqp view` with --save FILE")
        text = self.server.session.text(body.get("values", {}), target)
        try:
            target.write_text(text, encoding="utf-8")
        except OSError as fault:
            raise ScenarioError(f"{target} cannot be written: {fault.strerror}") from None
        return {"saved": str(target)}

    def _check_host(self) -> None:
        if self.headers.get("Host", "").lower() not in self.server.hosts():
            _forbid("this page is for this computer alone, under 127.0.0.1 or localhost")

    def _is_token(self, given: str) -> bool:
        return compare_digest(given.encode("utf-8", "replace"), self.server.token.encode())

    def _body(self) -> dict[str, Any]:
        """Table of a request's JSON."""
        if self.headers.get_content_type() != "application/json":
            raise Refused(HTTPStatus.UNSUPPORTED_MEDIA_TYPE, "send JSON as application/json")
        length = self.headers.get("Content-Length", "")
        if not (length.isascii() and length.isdigit()):
            raise Refused(HTTPStatus.LENGTH_REQUIRED, "a request needs a Content-Length")
        if len(length) > 9 or int(length) > LARGEST:
            raise Refused(
                HTTPStatus.REQUEST_ENTITY_TOO_LARGE, f"a request may have {LARGEST} bytes at most"
            )
        raw = self.rfile.read(int(length))
        try:
            found = json.loads(raw, parse_constant=_refuse_constant)
        except (ValueError, RecursionError) as fault:  # no JSON, not UTF-8, nested too deeply
            raise ScenarioError(f"the request is no JSON: {fault}") from None
        if not isinstance(found, dict):
            raise ScenarioError("the request must be a JSON object")
        return found

    def _send(self, status: HTTPStatus, content: Mapping[str, Any]) -> None:
        text = json.dumps(content, allow_nan=False, separators=(",", ":"))
        self._send_text(status, text, "application/json", {})

    def _send_text(self, status: HTTPStatus, text: str, kind: str, more: Mapping[str, str]) -> None:
        data = text.encode("utf-8", "replace")
        self.send_response(status)
        headers = {"Content-Type": kind, "Content-Length": str(len(data)), **HEADERS, **more}
        for name, value in headers.items():
            self.send_header(name, value)
        if self.close_connection:
            self.send_header("Connection", "close")
        self.end_headers()
        self.wfile.write(data)


def _forbid(sentence: str) -> NoReturn:
    raise Refused(HTTPStatus.FORBIDDEN, sentence)


def _refuse_constant(name: str) -> NoReturn:
    raise ValueError(f"{name} is no number")


def _flag(body: Mapping[str, Any], key: str) -> bool:
    """True or false in a request; false if it is not there."""
    value = body.get(key, False)
    if not isinstance(value, bool):
        raise ScenarioError(f"{key} must be true or false")
    return value
