"""Failures of a provider, in plain words, transient or not."""

from __future__ import annotations

from typing import TYPE_CHECKING

from palpate.planning.model.provider import Endpoint
from palpate.planning.model.wire import is_too_large
from palpate.redaction import redact

if TYPE_CHECKING:
    from pydantic_ai.exceptions import ModelAPIError

TOO_LARGE = "the reply is larger than any plan; check the base URL"
NOT_THE_API = "the reply is not in the form of this provider's API; check the base URL"


def may_pass(error: ModelAPIError) -> bool:
    """True if the same request may succeed a little later."""
    from pydantic_ai import exceptions as e

    kinds = (
        e.ModelRateLimitError,
        e.ModelUnavailableError,
        e.ModelServerError,
        e.ModelConnectionError,
        e.ModelRequestTimeout,
    )
    return isinstance(error, kinds) and not is_too_large(error)


def reason(error: ModelAPIError, endpoint: Endpoint) -> str:
    """Description of a failure with a remedy, without the provider's own text where that may be
    long."""
    from pydantic_ai import exceptions as e

    status = f" (HTTP {error.status_code})" if isinstance(error, e.ModelHTTPError) else ""
    if is_too_large(error):
        return TOO_LARGE
    if isinstance(error, e.ModelAuthenticationError):
        return f"the key was refused{status}; check {endpoint.provider.key_variables[0]} and what it may use"
    if isinstance(error, e.ModelNotFoundError):
        return f"there is no model '{endpoint.model}' at this address{status}; check the name and the base URL"
    if isinstance(error, e.ModelQuotaExceededError):
        return f"quota or credit is used up{status}; see your account with the provider"
    if isinstance(error, e.ModelRateLimitError):
        return f"the provider limits the rate{status}"
    if isinstance(error, e.ModelRequestTimeout | e.ModelTimeoutError):
        return "no answer came in time"
    if isinstance(error, e.ModelConnectionError):
        return "the provider cannot be reached; check the network and the base URL"
    if isinstance(error, e.ModelServerError | e.ModelUnavailableError):
        return f"the provider failed{status}"
    if not isinstance(error, e.ModelHTTPError):
        return NOT_THE_API
    return f"the request was refused{status}: {redact(' '.join(str(error.body).split()))[:200]}"
