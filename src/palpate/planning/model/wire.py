"""The HTTP client that models are asked through: no redirects, and answers of bounded size."""

from __future__ import annotations

from collections.abc import AsyncIterator
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    import httpx2

MAX_BODY = 2_000_000
"""Bytes of one reply; a plan of fifteen objects is some 20 kB."""
MAX_COMPRESSED_BODY = 100_000
"""Bytes of a reply that is sent compressed, where a byte may become a thousand."""


class ReplyTooLarge(Exception):
    """The provider sends more than is read."""


def bounded_client(seconds: float) -> httpx2.AsyncClient:
    """A client whose replies end in `ReplyTooLarge` when they grow beyond the bound. Close it with
    `async with`."""
    import httpx2

    return httpx2.AsyncClient(
        timeout=httpx2.Timeout(seconds, connect=min(10.0, seconds)),
        follow_redirects=False,
        event_hooks={"response": [_bound]},
    )


def is_too_large(error: BaseException) -> bool:
    """True if a `ReplyTooLarge` is at the bottom of `error`."""
    link: BaseException | None = error
    while link is not None:
        if isinstance(link, ReplyTooLarge):
            return True
        link = link.__cause__ or link.__context__
    return False


async def _bound(response: httpx2.Response) -> None:
    import httpx2

    compressed = response.headers.get("content-encoding", "identity") != "identity"
    limit = MAX_COMPRESSED_BODY if compressed else MAX_BODY
    declared = response.headers.get("content-length", "0")
    if declared.isdigit() and int(declared) > limit:
        raise ReplyTooLarge
    inner = response.stream
    assert isinstance(inner, httpx2.AsyncByteStream)

    class Bounded(httpx2.AsyncByteStream):
        async def __aiter__(self) -> AsyncIterator[bytes]:
            read = 0
            async for chunk in inner:
                read += len(chunk)
                if read > limit:
                    raise ReplyTooLarge
                yield chunk

        async def aclose(self) -> None:
            await inner.aclose()

    response.stream = Bounded()
