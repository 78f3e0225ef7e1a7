"""Reading JSON files of bounded size, with errors that name the file."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

LARGEST_JSON = 1 << 27
"""Bytes."""


def read_json(path: Path, largest: int = LARGEST_JSON) -> Any:
    """The JSON value of a file. largest: bytes that a file may have.

    Raises ValueError with the path for other content, a larger file, and numbers that are not finite.
    """

    def refuse(constant: str) -> None:
        raise ValueError(f"{path}: holds {constant}, needs finite numbers")

    try:
        if path.stat().st_size > largest:
            raise ValueError(f"{path}: {path.stat().st_size} bytes, needs at most {largest}")
        return json.loads(path.read_text(encoding="utf-8-sig"), parse_constant=refuse)
    except FileNotFoundError:
        raise ValueError(f"{path}: no such file") from None
    except json.JSONDecodeError as error:
        raise ValueError(f"{path}:{error.lineno}: not JSON ({error.msg})") from None
    except UnicodeDecodeError:
        raise ValueError(f"{path}: not a text file") from None
    except ValueError as error:
        # A whole number of too many digits has an error without the path.
        raise ValueError(str(error) if str(error).startswith(f"{path}:") else f"{path}: {error}") from None
    except RecursionError:
        raise ValueError(f"{path}: nested too deep") from None
