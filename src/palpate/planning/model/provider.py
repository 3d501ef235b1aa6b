"""Providers of models: names, defaults, and the sources of their keys and addresses. No SDK is loaded
here."""

from __future__ import annotations

import os
from dataclasses import dataclass
from urllib.parse import urlsplit

from palpate.errors import InputError, Unavailable, unknown_name


@dataclass(frozen=True, slots=True)
class Provider:
    """Provider of models.

    Attributes:
        name: prefix in `--planner NAME:MODEL`.
        extra: pip extra that installs its SDK.
        key_variables: environment variables that may hold its key, the first wins.
        url_variable: environment variable that may hold its address.
        model: default model; empty where that depends on the server.
        url: default address, None for the SDK's own, empty where one must be given.
        key_required: it needs a key.
    """

    name: str
    extra: str
    key_variables: tuple[str, ...]
    url_variable: str
    model: str = ""
    url: str | None = None
    key_required: bool = True

    def key(self) -> str | None:
        """The key in the environment, if any."""
        return next((value for v in self.key_variables if (value := os.environ.get(v))), None)

    def require_key(self) -> None:
        """Raise Unavailable if the provider needs a key and the environment has none."""
        if self.key_required and not self.key():
            raise Unavailable(
                f"the planner '{self.name}' needs a key: set {self.key_variables[0]} in the environment, "
                "or use planner=symbolic, which needs none"
            )

    def address(self, base_url: str | None) -> str | None:
        """The address to use: `base_url`, else the environment's, else the default.

        Raises:
            InputError: it is not an http or https address, or there is none.
        """
        url = base_url or os.environ.get(self.url_variable) or self.url
        if url == "":
            raise InputError(
                f"the planner '{self.name}' needs an address: give base_url=URL, or set {self.url_variable}"
            )
        if url is not None and (
            urlsplit(url).scheme not in ("http", "https") or not urlsplit(url).hostname
        ):
            raise InputError(
                "the base URL must start with http:// or https:// and name a host, "
                "e.g. http://localhost:8080/v1"
            )
        return url


def _local(name: str, variables: str, url: str) -> Provider:
    """A server that speaks OpenAI chat completions and needs no key."""
    keys, url_variable = (f"{variables}_API_KEY",), f"{variables}_BASE_URL"
    return Provider(name, "openai", keys, url_variable, url=url, key_required=False)


PROVIDERS = {
    p.name: p
    for p in (
        Provider("openai", "openai", ("OPENAI_API_KEY",), "OPENAI_BASE_URL", "gpt-6.1-terra"),
        Provider(
            "google",
            "google",
            ("GOOGLE_API_KEY", "GEMINI_API_KEY"),
            "GOOGLE_GEMINI_BASE_URL",
            "gemini-3.8-flash",
        ),
        Provider(
            "anthropic",
            "anthropic",
            ("ANTHROPIC_API_KEY",),
            "ANTHROPIC_BASE_URL",
            "claude-sonnet-5-5",
        ),
        _local("ollama", "OLLAMA", "http://localhost:11434/v1"),
        _local("vllm", "VLLM", "http://localhost:8000/v1"),
        _local("compatible", "OPENAI_COMPATIBLE", ""),
    )
}
"""`compatible` is any other server that speaks OpenAI chat completions, such as llama.cpp's."""


@dataclass(frozen=True, slots=True)
class Endpoint:
    """Model of a provider with its address, None for the SDK's own."""

    provider: Provider
    model: str
    address: str | None

    @classmethod
    def of(cls, planner: str, base_url: str | None = None) -> Endpoint:
        """Endpoint of `PROVIDER:MODEL` or `PROVIDER`.

        Raises:
            InputError: unknown provider, no model where there is no default, or no address.
            Unavailable: the provider needs a key and the environment has none.
        """
        provider, model = find_provider(planner)
        provider.require_key()
        return cls(provider, model, provider.address(base_url))

    @property
    def name(self) -> str:
        """`PROVIDER:MODEL`."""
        return f"{self.provider.name}:{self.model}"


def find_provider(planner: str) -> tuple[Provider, str]:
    """Provider and model of `PROVIDER:MODEL` or `PROVIDER`.

    Raises:
        InputError: unknown provider, or no model where there is no default.
    """
    name, _, model = planner.partition(":")
    if name not in PROVIDERS:
        raise unknown_name("provider", name, PROVIDERS)
    provider = PROVIDERS[name]
    if not (model or provider.model):
        raise InputError(
            f"the planner '{name}' needs a model: '{name}:MODEL', with a model your server has"
        )
    return provider, model or provider.model
