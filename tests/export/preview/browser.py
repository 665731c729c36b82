# SPDX-License-Identifier: Apache-2.0
"""A headless Chromium for tests of pages, driven by Selenium; without network."""

import shutil
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

FLAGS = (
    *("--headless", "--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-background-networking"),
    *(
        "--disable-component-update",
        "--disable-sync",
        "--disable-dev-shm-usage",
        "--host-resolver-rules=MAP * ~NOTFOUND",
    ),
)


@contextmanager
def browser(profile: Path, *flags: str, width: int = 1440, height: int = 1000) -> Iterator[Any]:
    """Start a browser; skip the test if there is none.

    Args:
        profile: a new folder for its data.
        flags: further command-line flags.
        width: of the window, px.
        height: of the window, px.
    """
    webdriver = pytest.importorskip("selenium.webdriver")
    chromium, driver = shutil.which("chromium"), shutil.which("chromedriver")
    if chromium is None or driver is None:
        pytest.skip("there is no chromium with chromedriver")
    options = webdriver.ChromeOptions()
    options.binary_location = chromium
    for flag in (*FLAGS, f"--window-size={width},{height}", f"--user-data-dir={profile}", *flags):
        options.add_argument(flag)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    from selenium.webdriver.chrome.service import Service

    page = webdriver.Chrome(options=options, service=Service(driver))
    try:
        yield page
    finally:
        page.quit()


def console_errors(page: Any) -> list[str]:
    """Return what the page has reported to the console."""
    return [entry["message"] for entry in page.get_log("browser")]
