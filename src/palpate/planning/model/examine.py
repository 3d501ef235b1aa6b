"""Examination of a model for `palpate doctor --planner`, with remedies line by line.

It tests availability, context length and vision.
"""

from __future__ import annotations

import asyncio
import io
from collections.abc import Iterator
from typing import Any, cast

from PIL import Image

from palpate.common.errors import Unavailable
from palpate.common.redaction import redact
from palpate.planning.model.conversation import Answer
from palpate.planning.model.prompt import fence, system_prompt
from palpate.planning.model.provider import (
    PROVIDERS,
    Endpoint,
    Provider,
    ReplyTooLarge,
    bounded_client,
)
from palpate.planning.model.session import ModelSession, Picture
from palpate.planning.model.settings import Budget
from palpate.primitives.registry import vocabulary

Line = tuple[bool, str, str]
"""Success flag, subject, and finding or remedy."""

LISTED = 12
"""Maximum number of models in a line."""
ADDRESSES = {
    "openai": "https://api.openai.com/v1",
    "google": "https://generativelanguage.googleapis.com",
    "anthropic": "https://api.anthropic.com",
}
"""Addresses of the providers' own clients."""
LISTS = {"google": "/v1beta/models?pageSize=1000", "anthropic": "/v1/models?limit=1000"}
"""Paths of the model lists; `/models` for other providers."""
PING = "Answer with the one word: ready"
WORD = "marmalade"
"""Word to be remembered, placed before a whole system prompt."""
COLOUR = "Which colour is this picture? Answer with one word, in English."
SIDE = 64
"""px. Side of the test picture."""


def examine(planner: str, base_url: str | None, seconds: float) -> Iterator[Line]:
    """Examine `PROVIDER[:MODEL]` with at most `seconds` per request. Raises InputError: the address is not usable."""
    name, _, model = planner.partition(":")
    provider = PROVIDERS[name]
    model = model or provider.model
    address = provider.address(base_url)
    yield True, "address", address or f"{ADDRESSES[name]} (the provider's own)"
    # Without a key no request can succeed.
    if provider.key_required and not provider.key():
        yield False, "key", f"set {provider.key_variables[0]} in the environment"
        return
    yield True, "key", "set" if provider.key() else "none, and none is needed"
    try:
        models = model_names(provider, address or ADDRESSES[name], seconds)
    except Unavailable as error:
        yield False, "models", str(error)
        models = ()
    else:
        yield check_model_name(provider, model, models)
    # Only a named model can be asked.
    if model:
        yield from try_model(Endpoint(provider, model, address), seconds)


def check_model_name(provider: Provider, model: str, models: tuple[str, ...]) -> Line:
    """State the models of the server, and if the chosen one is among them."""
    more = f" and {len(models) - LISTED} more" if len(models) > LISTED else ""
    listing = f"{', '.join(models[:LISTED])}{more}" or "none"
    if not model:
        return bool(models), "models", f"{listing}; choose one: --planner {provider.name}:MODEL"
    if model in models or f"{model}:latest" in models:
        return True, "models", f"'{model}' and {len(models) - 1} others"
    get = f"; ollama pull {model}" if provider.name == "ollama" else ""
    return False, "models", f"there is no '{model}'; there are: {listing}{get}"


def try_model(endpoint: Endpoint, seconds: float) -> Iterator[Line]:
    """Test the model by three requests.

    It must answer a word, remember a word before a text as long as a prompt, and name the colour of
    a picture.
    """

    def ask(question: str, *pictures: Picture) -> tuple[str, Answer]:
        # Each question is a separate dialogue without a system prompt.
        session = ModelSession(endpoint, "", pictures, None, Budget(seconds=seconds))
        answer = session.ask(question)
        return " ".join(answer.text.split())[:60], answer

    try:
        reply, answer = ask(PING)
    except Unavailable as error:
        yield False, "answer", str(error)
        return
    of = answer.model or endpoint.model  # the name may be an alias
    yield bool(reply), "answer", f"'{reply}' in {answer.seconds:.1f} s from {of}"
    # Servers with a short context silently drop the beginning of a long text.
    text = fence(system_prompt(vocabulary()))
    question = "Which word was to be remembered? Answer with it alone."
    try:
        reply, answer = ask(f"Remember the word {WORD}.\n\n{text}\n\n{question}")
    except Unavailable as error:
        yield False, "context", f"{error}; give the model a longer one"
    else:
        remembered = WORD in reply.lower()
        yield (
            remembered,
            "context",
            f"a prompt of {answer.input_tokens} tokens is read from its beginning, in "
            f"{answer.seconds:.1f} s"
            if remembered
            else "the beginning of a prompt as long as ours is not read any more; a longer context is "
            "needed, with Ollama OLLAMA_CONTEXT_LENGTH=16384",
        )
    # A model without vision rejects the picture or names another colour.
    red = io.BytesIO()
    Image.new("RGB", (SIDE, SIDE), (220, 20, 20)).save(red, "JPEG")
    try:
        reply, _ = ask(COLOUR, Picture(red.getvalue(), SIDE, SIDE))
    except Unavailable as error:
        yield False, "pictures", f"{error}; take a model that sees, or --without image"
    else:
        yield "red" in reply.lower(), "pictures", f"a red one is called '{reply}'"


def model_names(provider: Provider, address: str, seconds: float) -> tuple[str, ...]:
    """Return the names of the server's models.

    Raises Unavailable: it is unreachable, refuses, or sends no such list.
    """
    url = address.rstrip("/") + LISTS.get(provider.name, "/models")
    # Each provider has its own header for the key.
    key = provider.key() or ""
    headers = {"authorization": f"Bearer {key}"} if key else {}
    if provider.name == "google":
        headers = {"x-goog-api-key": key}
    elif provider.name == "anthropic":
        headers = {"x-api-key": key, "anthropic-version": "2023-06-01"}
    try:
        document = asyncio.run(fetch_json(url, headers, seconds))
    except ImportError:
        raise Unavailable(f"pip install 'palpate[{provider.extra}]'") from None
    # OpenAI and Anthropic list under "data" by id, Google under "models" by name.
    entries: object = document.get("data") or document.get("models") or []
    # A list of another form means another kind of server.
    if not isinstance(entries, list):
        raise Unavailable(f"{url} sends no list of models; check the base URL")
    names: list[str] = []
    for entry in cast("list[Any]", entries):
        if isinstance(entry, dict):
            named = cast("dict[str, Any]", entry)
            name = str(named.get("id") or named.get("name") or "")
            names.append(redact(name.removeprefix("models/"))[:100])
    return tuple(name for name in names if name)


async def fetch_json(url: str, headers: dict[str, str], seconds: float) -> dict[str, Any]:
    """Fetch the JSON object at a URL. Raises Unavailable: the server sends none."""
    import httpx2

    shown = url.partition("?")[0]
    try:
        async with bounded_client(seconds) as client:
            response = await client.get(url, headers=headers)
            document: object = response.json() if response.is_success else None
    except (
        httpx2.HTTPError,
        httpx2.InvalidURL,
        ReplyTooLarge,
        ValueError,
        RecursionError,
        OSError,
    ):
        raise Unavailable(f"{shown} cannot be read; is the server running there?") from None
    if not isinstance(document, dict):
        raise Unavailable(f"{shown} answers HTTP {response.status_code} and no list of models")
    return cast("dict[str, Any]", document)
