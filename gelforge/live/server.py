"""The page and the WebSocket: one thread with an event loop; every client is sent the newest reading only.

A client that reads slowly holds back nobody but itself: its task waits while newer readings replace the one it has not
fetched. A web page of another site may not connect (see `why_refused`).
"""

from __future__ import annotations

import asyncio
import errno
import http
import ipaddress
import json
import queue
import socket
import threading
from importlib import resources
from urllib.parse import parse_qs, urlsplit

from websockets.asyncio.server import ServerConnection, serve
from websockets.datastructures import Headers
from websockets.exceptions import ConnectionClosed
from websockets.http11 import Request, Response

from gelforge.live.capture import LiveError
from gelforge.live.messages import text_of

STREAM = "/stream"
COMMANDS = ("zero", "record", "stop")

MOST_CLIENTS = 16  # with 30 kB of bins each at 30 frames per second they take 14 MB/s (judgement)
SAFETY = {  # of the page: it loads nothing from anywhere and stands in no other page
    "Content-Security-Policy": "default-src 'none'; style-src 'unsafe-inline'; script-src 'unsafe-inline'; "
    "connect-src 'self'; img-src data:; frame-ancestors 'none'",
    "X-Content-Type-Options": "nosniff",
    "Cache-Control": "no-store",
}


def why_refused(host: str | None, origin: str | None) -> str:
    """Return why a request is refused; "" where it is not.

    Host must be localhost, an address or this machine's name: another name that leads here is a foreign page's trick (DNS
    rebinding). Origin, which browsers send, must be the server itself; robots send none.
    """
    try:
        name = urlsplit(f"//{host}").hostname if host else None
        page = urlsplit(origin).netloc.lower() if origin is not None else None
    except ValueError:
        return f"host {host!r} or origin {origin!r} is no address"
    if name is None or not (name in ("localhost", socket.gethostname().lower()) or _is_address(name)):
        return f"host {host!r} is not this machine's name or address; open the page by its address"
    if page is not None and page != (host or "").lower():
        return f"a page of {origin!r} may not read this stream; open the server's own page"
    return ""


def _is_address(name: str) -> bool:
    try:
        ipaddress.ip_address(name)
    except ValueError:
        return False
    return True


class Server:
    """Serves from a thread of its own; a context manager. publish() may be called from any thread."""

    def __init__(self, host: str, port: int, about: dict):
        self.host, self.port, self.about = host, port, about
        self.commands: queue.SimpleQueue[str] = queue.SimpleQueue()  # what clients ask for
        self._page = resources.files("gelforge.live").joinpath("page.html").read_bytes()
        self._slots: set[_Slot] = set()
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(target=self._loop.run_forever, name="server", daemon=True)

    def __enter__(self) -> Server:
        self._thread.start()
        try:
            self._server = asyncio.run_coroutine_threadsafe(self._serve(), self._loop).result()
        except OSError as error:
            self._finish()
            words = {errno.EADDRINUSE: "is in use; give another --port, or end the program that holds it"}
            why = words.get(
                error.errno or 0, f"cannot be served on ({error.strerror}); give another --host or --port"
            )
            raise LiveError(f"port {self.port} of {self.host} {why}") from None
        except OverflowError:
            self._finish()
            raise LiveError(f"--port {self.port}: give a number from 0 to 65535") from None
        self.port = self._server.sockets[0].getsockname()[1]
        return self

    def __exit__(self, *_) -> None:
        async def close():
            self._server.close()
            await self._server.wait_closed()

        try:
            asyncio.run_coroutine_threadsafe(close(), self._loop).result(timeout=3)
        except TimeoutError:  # a client that takes nothing is not waited for
            pass
        self._finish()

    def _finish(self) -> None:
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join(timeout=2)

    @property
    def url(self) -> str:
        """The address of the page."""
        host = {"0.0.0.0": "127.0.0.1", "::": "[::1]", "": "127.0.0.1"}.get(self.host, self.host)
        return f"http://{f'[{host}]' if ':' in host and host[0] != '[' else host}:{self.port}/"

    @property
    def clients(self) -> int:
        return len(self._slots)

    @property
    def wants_field(self) -> bool:
        """Whether any client asks for the force of each bin."""
        return any(slot.field for slot in tuple(self._slots))

    def publish(self, message: dict) -> None:
        """Give every client this message, in place of one that it has not fetched."""
        self._loop.call_soon_threadsafe(self._give, message)

    def end(self, text: str) -> None:
        """Tell every client that the stream ends, and why."""
        message = {"type": "end", "text": text}
        asyncio.run_coroutine_threadsafe(self._tell_all(message), self._loop).result(timeout=3)

    async def _tell_all(self, message: dict) -> None:
        text = text_of(message)
        telling = asyncio.gather(*(_sent(slot.client, text) for slot in self._slots))
        try:
            await asyncio.wait_for(telling, timeout=1)
        except TimeoutError:  # a client that takes nothing is not waited for
            pass

    def _give(self, message: dict) -> None:
        for slot in self._slots:
            slot.put(message)

    async def _serve(self):
        return await serve(
            self._client,
            self.host,
            self.port,
            process_request=self._answer,
            max_size=1024,  # bytes: commands have some twenty
            max_queue=4,
            compression=None,
            ping_interval=10,  # s
            ping_timeout=10,  # s, until a client that answers none is given up
            close_timeout=1,
            server_header=None,
        )

    def _answer(self, client: ServerConnection, request: Request) -> Response | None:
        """Return the page or a refusal; None lets a WebSocket through."""
        for name in ("Host", "Origin", "Upgrade"):
            if (count := len(request.headers.get_all(name))) > 1:
                return client.respond(http.HTTPStatus.BAD_REQUEST, f"{count} headers {name}, send one\n")
        if why := why_refused(request.headers.get("Host"), request.headers.get("Origin")):
            return client.respond(http.HTTPStatus.FORBIDDEN, why + "\n")
        path = urlsplit(request.path).path
        if path == STREAM:
            if "websocket" not in request.headers.get("Upgrade", "").lower():
                return client.respond(http.HTTPStatus.UPGRADE_REQUIRED, "a WebSocket is served here\n")
            if self.clients >= MOST_CLIENTS:
                return client.respond(
                    http.HTTPStatus.SERVICE_UNAVAILABLE, f"{MOST_CLIENTS} clients are connected, no more\n"
                )
            return None
        if path not in ("/", "/index.html"):
            return client.respond(http.HTTPStatus.NOT_FOUND, f"only / and {STREAM} are here\n")
        headers = {"Content-Type": "text/html; charset=utf-8", "Content-Length": str(len(self._page))}
        return Response(200, "OK", Headers(headers | SAFETY | {"Connection": "close"}), self._page)

    async def _client(self, client: ServerConnection) -> None:
        """Send to one client until it goes, and take its commands."""
        assert client.request is not None  # the handshake is over
        asked = parse_qs(urlsplit(client.request.path).query)
        slot = _Slot(client, asked.get("field", ["0"])[-1] == "1", _rate(asked))
        try:
            await client.send(text_of(self.about))
            self._slots.add(slot)
            sending = asyncio.ensure_future(slot.send_newest())
            try:
                async for text in client:
                    await self._take(client, text)
            finally:
                sending.cancel()
        except ConnectionClosed:  # it has vanished, or sent too much at once
            pass
        finally:
            self._slots.discard(slot)

    async def _take(self, client: ServerConnection, text: str | bytes) -> None:
        try:
            command = json.loads(text)["do"]
            if command not in COMMANDS:
                raise ValueError
        except (ValueError, TypeError, KeyError, RecursionError):
            reported = f'not understood; send {{"do": "{COMMANDS[0]}"}}, or one of {", ".join(COMMANDS)}'
            await client.send(text_of({"type": "refused", "text": reported}))
            return
        self.commands.put(command)


def _rate(asked: dict) -> float:
    """Return the most messages per second that a client asks for; as they come where it does not."""
    try:
        rate = float(asked["rate"][-1])
    except (KeyError, ValueError):
        return float("inf")
    return rate if 0 < rate else float("inf")


async def _sent(client: ServerConnection, text: str) -> None:
    try:
        await client.send(text)
    except ConnectionClosed:
        pass


class _Slot:
    """The newest message that a client has not been sent."""

    def __init__(self, client: ServerConnection, field: bool, rate: float):
        self.client, self.field, self.pause_s = client, field, 1 / rate
        self._message: dict = {}  # none until _there is set
        self._there = asyncio.Event()

    def put(self, message: dict) -> None:
        self._message = message
        self._there.set()

    async def send_newest(self) -> None:
        try:
            while True:
                await self._there.wait()
                self._there.clear()
                await self.client.send(text_of(self._message if self.field else without_field(self._message)))
                if self.pause_s:
                    await asyncio.sleep(self.pause_s)
        except ConnectionClosed:
            pass


def without_field(message: dict) -> dict:
    """Return a message without the forces of the bins."""
    return {name: value for name, value in message.items() if not name.startswith("field_")}
