import pytest

from palpate.common.errors import InputError, Unavailable
from palpate.planning.model.provider import PROVIDERS, find_provider


def test_a_provider_alone_stands_for_its_default_model() -> None:
    provider, model = find_provider("openai")
    assert model == provider.model != ""


def test_a_model_name_may_hold_colons_and_slashes() -> None:
    assert find_provider("ollama:qwen3-vl:8b")[1] == "qwen3-vl:8b"
    assert find_provider("vllm:Qwen/Qwen3-VL-8B")[1] == "Qwen/Qwen3-VL-8B"


def test_the_default_models_are_known_to_the_sdk() -> None:
    models = pytest.importorskip("pydantic_ai.models")
    known = set(models.KnownModelName.__value__.__args__)
    assert {f"{p.name}:{p.model}" for p in PROVIDERS.values() if p.model} <= known


@pytest.mark.parametrize("planner", ["opanai:x", "", ":x", "OpenAI"])
def test_an_unknown_provider_is_named_with_those_there_are(planner: str) -> None:
    with pytest.raises(InputError, match="anthropic, compatible, google, ollama, openai, vllm"):
        find_provider(planner)


def test_a_server_without_a_default_needs_a_model() -> None:
    with pytest.raises(InputError, match="'ollama:MODEL'"):
        find_provider("ollama")


def test_a_missing_key_names_the_variable(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("ANTHROPIC_API_KEY", raising=False)
    with pytest.raises(Unavailable, match="set ANTHROPIC_API_KEY"):
        PROVIDERS["anthropic"].require_key()
    PROVIDERS["ollama"].require_key()


def test_the_address_is_given_or_in_the_environment_or_the_default(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    ollama = PROVIDERS["ollama"]
    monkeypatch.delenv("OLLAMA_BASE_URL", raising=False)
    assert ollama.address(None) == "http://localhost:11434/v1"
    monkeypatch.setenv("OLLAMA_BASE_URL", "http://gpu:11434/v1")
    assert ollama.address(None) == "http://gpu:11434/v1"
    assert ollama.address("http://here:1/v1") == "http://here:1/v1"


@pytest.mark.parametrize("url", ["ftp://x", "file:///etc/passwd", "localhost:8080", "http://"])
def test_an_address_must_be_http(url: str) -> None:
    with pytest.raises(InputError, match="http://"):
        PROVIDERS["openai"].address(url)


def test_a_compatible_server_needs_an_address(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("OPENAI_COMPATIBLE_BASE_URL", raising=False)
    with pytest.raises(InputError, match="base_url="):
        PROVIDERS["compatible"].address(None)
