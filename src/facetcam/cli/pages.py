"""Pages in the browser that stay until they are ended."""

from __future__ import annotations

import time
from typing import Protocol


class Page(Protocol):
    """A page with a server of its own."""

    @property
    def address(self) -> str: ...
    def stop(self) -> None: ...


def keep_open(page: Page, command: str) -> None:
    """Say where the page is, and keep it open until Ctrl-C."""
    print(f"facetcam {command}: open {page.address} in a browser; Ctrl-C ends it", flush=True)
    try:
        while True:
            time.sleep(0.5)
    finally:
        page.stop()
