"""Access control of the bench: host name, token, origin of forms, size limit and headers.

Every request is checked before it is answered:

- the `Host` header must be one of the server's own names, so that a foreign page whose name is
  resolved to this machine (DNS rebinding) gets nothing;
- the browser must have opened the link with the token once, which gave it a cookie; the token
  itself is not in the cookie, nor in any other link or log;
- a request that changes anything must come from a page of this server (`Origin`), and contain the
  key of its forms (`Secrets.key`), which no other page can read;
- the body must not exceed the size limit.

Source: OWASP cheat sheets "Cross-Site Request Forgery Prevention" and "HTTP Headers".
"""

from __future__ import annotations

import hashlib
import hmac
from collections.abc import Mapping
from dataclasses import dataclass
from http.cookies import CookieError, SimpleCookie
from urllib.parse import parse_qsl, urlencode

from starlette.datastructures import Headers, MutableHeaders
from starlette.exceptions import HTTPException
from starlette.responses import PlainTextResponse, RedirectResponse, Response
from starlette.types import ASGIApp, Message, Receive, Scope, Send

_KEPT_S = 30 * 24 * 3600  # [s] lifetime of the cookie
_READING = ("GET", "HEAD")
POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self' data:; "
    "connect-src 'self'; form-action 'self'; base-uri 'none'; frame-ancestors 'none'"
)
# Pages that the verbs write contain inline scripts, so they are sandboxed apart from the bench.
APART = (
    "sandbox allow-scripts; default-src 'none'; script-src 'unsafe-inline'; "
    "style-src 'unsafe-inline'; img-src data: blob:; base-uri 'none'; form-action 'none'"
)
HEADERS: Mapping[str, str] = {
    "content-security-policy": POLICY,
    "x-content-type-options": "nosniff",
    "x-frame-options": "DENY",
    "referrer-policy": "same-origin",
    "cross-origin-opener-policy": "same-origin",
    "cross-origin-resource-policy": "same-origin",
    "permissions-policy": "camera=(), microphone=(), geolocation=()",
    "cache-control": "no-store",
}


@dataclass(frozen=True)
class Secrets:
    """The token of a link, with the cookie of known browsers and the form key derived from it."""

    token: str

    def opens(self, token: str) -> bool:
        """Whether the token is right, compared in constant time."""
        return hmac.compare_digest(token.encode(), self.token.encode())

    @property
    def cookie(self) -> str:
        """Value of the cookie of a browser that was opened with the token."""
        return self._word("cookie")

    @property
    def key(self) -> str:
        """Key that every form contains."""
        return self._word("form")

    def knows(self, cookie: str) -> bool:
        """Whether the cookie is right, compared in constant time."""
        return hmac.compare_digest(cookie.encode(), self.cookie.encode())

    def require_key(self, given: str) -> None:
        """Refuse a form that does not come from a page of this server.

        Raises:
            HTTPException: 403.
        """
        if not hmac.compare_digest(given.encode(), self.key.encode()):
            raise HTTPException(
                403, "this form does not come from a page of this bench: load the page again"
            )

    def _word(self, use: str) -> str:
        return hmac.new(self.token.encode(), use.encode(), hashlib.sha256).hexdigest()


class Guard:
    """ASGI middleware that makes the checks above, and adds headers to every answer."""

    def __init__(self, app: ASGIApp, secrets: Secrets, hosts: frozenset[str], most: int) -> None:
        """Guard an application.

        Args:
            app: application to guard.
            secrets: secrets of this server.
            hosts: allowed values of the `Host` header, in lower case, with the port.
            most: most bytes of a body.
        """
        self._app, self._secrets, self._hosts, self._most = app, secrets, hosts, most

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Answer a request, or pass it on to the application."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return

        async def with_headers(message: Message) -> None:
            if message["type"] == "http.response.start":
                own = MutableHeaders(scope=message)
                for name, value in HEADERS.items():
                    own.setdefault(name, value)
            await send(message)

        try:
            answer = self._let_through(scope) or self._app
        except HTTPException as refused:
            answer = PlainTextResponse(f"{refused.detail}\n", refused.status_code)
        await answer(scope, self._bounded(receive), with_headers)

    def _let_through(self, scope: Scope) -> Response | None:
        """Check a request: None if the application may answer, a redirect if its token is right.

        Raises:
            HTTPException: the request is refused.
        """
        headers = Headers(scope=scope)
        host = self._require_host(headers)
        name = _cookie_name(host)
        if scope["method"] in _READING and (given := _token(scope)):
            if not self._secrets.opens(given):
                raise HTTPException(403, "the token of this link is not valid, or no longer valid")
            return self._opened(scope, name)
        self._require_known(headers, name)
        if scope["method"] not in _READING:
            self._require_own_page(headers, host)
            self._require_small(headers)
        return None

    def _require_host(self, headers: Headers) -> str:
        host = headers.get("host", "").lower()
        if host not in self._hosts:
            raise HTTPException(421, "this server is not known by that name")
        return host

    def _require_known(self, headers: Headers, name: str) -> None:
        if not self._secrets.knows(_cookie(headers, name)):
            raise HTTPException(
                403,
                "this browser has not been admitted: open the link that delta-cal serve showed "
                "when "
                "it was started",
            )

    def _require_own_page(self, headers: Headers, host: str) -> None:
        if headers.get("origin", "") not in (f"http://{host}", f"https://{host}"):
            raise HTTPException(403, "this request does not come from a page of this bench")

    def _require_small(self, headers: Headers) -> None:
        length = headers.get("content-length", "0")
        if not length.isdigit() or int(length) > self._most:
            raise HTTPException(413, too_large(self._most))

    def _bounded(self, receive: Receive) -> Receive:
        """Limit the received bytes, whatever `Content-Length` says."""
        taken = 0

        async def bounded() -> Message:
            nonlocal taken
            message = await receive()
            taken += len(message.get("body", b""))
            if taken > self._most:
                raise HTTPException(413, too_large(self._most))
            return message

        return bounded

    def _opened(self, scope: Scope, name: str) -> RedirectResponse:
        """Redirect to the same page without the token, and set the cookie."""
        rest = urlencode([(k, v) for k, v in _query(scope) if k != "token"])
        path = "/" + scope["path"].lstrip("/")  # "//name" would redirect to another server
        answer = RedirectResponse(path + (f"?{rest}" if rest else ""), 303)
        answer.set_cookie(
            name, self._secrets.cookie, max_age=_KEPT_S, httponly=True, samesite="lax"
        )
        return answer


def too_large(most: int) -> str:
    """Message for a body that is too large."""
    return f"larger than the limit of {most / (1 << 20):.0f} MB (delta-cal serve --most)"


def _query(scope: Scope) -> list[tuple[str, str]]:
    return parse_qsl(scope["query_string"].decode("latin-1"), keep_blank_values=True)


def _token(scope: Scope) -> str:
    return dict(_query(scope)).get("token", "")


def _cookie_name(host: str) -> str:
    """Cookie name with the port: browsers share cookies between all ports of a host."""
    return f"delta_cal_{host.rpartition(':')[2]}"


def _cookie(headers: Headers, name: str) -> str:
    jar: SimpleCookie = SimpleCookie()
    try:
        jar.load(headers.get("cookie", ""))
    except CookieError:
        return ""
    return jar[name].value if name in jar else ""
