"""The SDK's model behind each provider. Loaded when a model is asked, never before."""

from __future__ import annotations

from typing import TYPE_CHECKING

from palpate.planning.model.provider import Endpoint

if TYPE_CHECKING:
    import httpx2
    from openai import AsyncOpenAI
    from pydantic_ai.models import Model
    from pydantic_ai.providers import Provider as SdkProvider


def sdk_model(endpoint: Endpoint, client: httpx2.AsyncClient) -> Model:
    """The SDK's model behind `endpoint`, asked through `client`.

    Raises:
        ImportError: the provider's SDK is not installed.
    """
    if endpoint.provider.name == "google":
        return _google_model(endpoint, client)
    if endpoint.provider.name == "anthropic":
        return _anthropic_model(endpoint, client)
    from pydantic_ai.models.openai import OpenAIChatModel

    return OpenAIChatModel(endpoint.model, provider=_speaks_openai(endpoint, client))


def _google_model(endpoint: Endpoint, client: httpx2.AsyncClient) -> Model:
    from pydantic_ai.models.google import GoogleModel
    from pydantic_ai.providers.google import GoogleProvider

    key = endpoint.provider.key()
    sdk = GoogleProvider(api_key=key, http_client=client, base_url=endpoint.address)
    return GoogleModel(endpoint.model, provider=sdk)


def _anthropic_model(endpoint: Endpoint, client: httpx2.AsyncClient) -> Model:
    from pydantic_ai.models.anthropic import AnthropicModel
    from pydantic_ai.providers.anthropic import AnthropicProvider

    key = endpoint.provider.key()
    sdk = AnthropicProvider(api_key=key, http_client=client, base_url=endpoint.address)
    return AnthropicModel(endpoint.model, provider=sdk)


def _speaks_openai(endpoint: Endpoint, client: httpx2.AsyncClient) -> SdkProvider[AsyncOpenAI]:
    """Servers that answer OpenAI chat completions: OpenAI itself, or a compatible one."""
    from pydantic_ai.providers.ollama import OllamaProvider
    from pydantic_ai.providers.openai import OpenAIProvider
    from pydantic_ai.providers.openai_compatible import OpenAICompatibleProvider
    from pydantic_ai.providers.vllm import VLLMProvider

    name, key, address = endpoint.provider.name, endpoint.provider.key(), endpoint.address
    if name == "openai":
        return OpenAIProvider(base_url=address, api_key=key, http_client=client)
    if name == "ollama":
        return OllamaProvider(base_url=address, api_key=key, http_client=client)
    if name == "vllm":
        return VLLMProvider(base_url=address, api_key=key, http_client=client)
    assert address is not None  # Provider.address demands one
    return OpenAICompatibleProvider("compatible", base_url=address, api_key=key, http_client=client)
