"""Keys are blotted out of text, however they are written in it."""

from __future__ import annotations

import base64
import json
import re
import time
from urllib.parse import quote

import pytest

from palpate.common.redaction import redact, redact_document

KEY = "Zq7-unusual/key+0123456789&abcdef"


@pytest.fixture(autouse=True)
def _key(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("OPENAI_API_KEY", KEY)
    monkeypatch.setenv("OLLAMA_API_KEY", "none")


def base64_of(text: str) -> str:
    return base64.b64encode(text.encode()).decode()


FORMS = {
    "plain": KEY,
    "base64": base64_of(KEY),
    "base64 after one byte": base64_of(f"x{KEY}"),
    "base64 after two bytes": base64_of(f"Be{KEY}er"),
    "base64 for addresses": base64.urlsafe_b64encode(KEY.encode()).decode(),
    "hexadecimal": KEY.encode().hex(),
    "percent-encoded": quote(KEY, safe=""),
    "every character percent-encoded": "".join(f"%{ord(c):02X}" for c in KEY),
    "percent-encoded twice": quote(quote(KEY, safe=""), safe=""),
    "escaped in JSON": "".join(f"\\u{ord(c):04x}" for c in KEY),
    "escaped in JSON twice": json.dumps("".join(f"\\u{ord(c):04x}" for c in KEY)),
    "entities": "".join(f"&#{ord(c)};" for c in KEY),
    "half plain, half escaped": KEY[:9] + "".join(f"\\x{ord(c):02x}" for c in KEY[9:]),
    "spread": " ".join(KEY),
    "spread by what nobody sees": "\u200b".join(KEY),
    "over two lines": f"{KEY[:15]}\n{KEY[15:]}",
    "backwards": KEY[::-1],
}


@pytest.mark.parametrize("form", FORMS)
def test_no_form_of_a_key_is_left(form: str) -> None:
    text = redact(f"it is {FORMS[form]}, as you know")
    assert "[key]" in text
    assert text.startswith("it is ")
    assert text.endswith("as you know")
    left = text.replace("[key]", "")
    for i in range(len(FORMS[form]) - 12):
        assert FORMS[form][i : i + 12] not in left


def test_parts_of_a_key_are_blotted_out_as_well() -> None:
    assert redact(f"first {KEY[:12]}, then {KEY[12:24]} and {KEY[24:]}").count("[key]") >= 2
    assert redact(f"cut off: {KEY[:-1]}") == "cut off: [key]"


def test_text_in_the_form_of_a_key_is_redacted() -> None:
    text = redact(
        "sk-proj-abcdefghijklmnop, Bearer abcdefghijklmnop, AIzaSyA1234567890123456789012"
    )
    assert text == "[key], [key], [key]"
    assert redact("https://me:secret@host/v1 and me@host") == "https://[key]@host/v1 and me@host"


@pytest.mark.parametrize("length", [6, 8, 12, 15, 19])
def test_a_short_key_is_blotted_out_whole(length: int, monkeypatch: pytest.MonkeyPatch) -> None:
    key = "pA5-sw0rd/k3y+Xv9qLm"[:length]
    monkeypatch.setenv("VLLM_API_KEY", key)
    for written in (key, base64_of(key), key.encode().hex(), quote(key, safe=""), " ".join(key)):
        # The last letters of base64 hold few bits of the key, or none.
        assert re.fullmatch(r"it is \[key\].{0,3}\.", redact(f"it is {written}."))


@pytest.mark.parametrize(
    "query", ["?key={}", "?v=1&key={}", "?api_key={}", "?api-key={}", "?access_token={}", "?sig={}"]
)
def test_a_key_in_the_query_of_an_address_is_blotted_out(query: str) -> None:
    address = f"https://host/v1{query.format('aB3')}&stream=true#end"
    assert redact(address) == f"https://host/v1{query.format('[key]')}&stream=true#end"
    assert redact("what?key=none of it") == "what?key=[key] of it"


def test_other_text_stays_as_it_is() -> None:
    text = "task-oriented sk-8, none of it a key: %20 \\u0041 &amp; unusual key"
    assert redact(text) == text


def test_documents_keep_their_form() -> None:
    document = {"a": [1, None, KEY], KEY: {"b": True, "c": f"x {KEY}"}}
    assert redact_document(document) == {
        "a": [1, None, "[key]"],
        "[key]": {"b": True, "c": "x [key]"},
    }


def test_redacting_a_long_text_takes_no_long_time() -> None:
    text = "Zq7-unusual and so on \\u005a " * 100_000
    started = time.perf_counter()
    redact(text)
    assert time.perf_counter() - started < 60
