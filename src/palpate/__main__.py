"""`python -m palpate`: the command line."""

from __future__ import annotations

from palpate.cli.main import main

if __name__ == "__main__":
    main()
