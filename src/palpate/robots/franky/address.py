"""`franky://HOST[?realtime=ignore]`: where a Franka's control box is, and how strictly it is served."""

from __future__ import annotations

import ipaddress
import re
from dataclasses import dataclass
from urllib.parse import parse_qsl, urlsplit

from palpate.errors import InputError

SCHEME = "franky"
FORM = "franky://HOST, e.g. franky://172.16.0.2, or franky://HOST?realtime=ignore"
_HOST = re.compile(r"[A-Za-z0-9._:-]+")


@dataclass(frozen=True, slots=True)
class Address:
    """A control box.

    Attributes:
        host: its name or IP address.
        realtime: whether this computer must have a realtime kernel, as a control loop of 1 kHz asks
            for; on loopback nothing is at stake.
    """

    host: str
    realtime: bool = True

    def __str__(self) -> str:
        return f"{SCHEME}://{self.host}"


def read_address(url: str) -> Address:
    """The address that a URL means.

    Raises:
        InputError: not of the form.
    """
    parts = urlsplit(url)
    host = parts.netloc
    options = dict(parse_qsl(parts.query, keep_blank_values=True))
    realtime = options.pop("realtime", None)
    bare = parts.path in ("", "/") and not parts.fragment and not options
    if parts.scheme != SCHEME or not _HOST.fullmatch(host) or not bare:
        raise InputError(f"'{url}' is no address of a Franka: give {FORM}")
    if realtime not in (None, "ignore", "enforce"):
        raise InputError(f"realtime={realtime} in '{url}': valid: enforce, ignore")
    if realtime is None:
        return Address(host, not _loopback(host))
    return Address(host, realtime == "enforce")


def _loopback(host: str) -> bool:
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        return host == "localhost"
