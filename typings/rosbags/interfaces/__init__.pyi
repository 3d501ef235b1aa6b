from enum import Enum
from typing import Any, NamedTuple

class MessageDefinitionFormat(Enum):
    NONE = ...
    MSG = ...
    IDL = ...

class MessageDefinition(NamedTuple):
    format: MessageDefinitionFormat
    data: str

class Connection(NamedTuple):
    topic: str
    msgtype: str
    msgdef: MessageDefinition
    ext: Any
