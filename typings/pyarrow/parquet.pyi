from pathlib import Path
from typing import Any

class ParquetFile:
    metadata: Any
    def __init__(self, source: Path) -> None: ...
    def read(self) -> Any: ...
