"""A headless browser for the tests of the report; without one they are skipped, and say so."""

import shutil
import warnings

import pytest

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
# WebGL without a graphics card; a container has no sandbox.
FLAGS = ["--no-sandbox", "--use-gl=angle", "--use-angle=swiftshader", "--enable-unsafe-swiftshader"]


def why_no_browser():
    """Why pages cannot be tried, or None."""
    if next(filter(None, map(shutil.which, NAMES)), None) is None:
        return f"NO BROWSER: none of {', '.join(NAMES)} is installed, so the report was NOT tried (apt-get install chromium)"
    try:
        import playwright  # noqa: F401, PLC0415
    except ImportError:
        return (
            "NO BROWSER: the package playwright is not installed, so the report was NOT tried (pip install playwright)"
        )
    return None


def open_browser():
    """Chromium, started by Playwright; skips loudly where there is none. A generator, for a fixture."""
    reason = why_no_browser()
    if reason is not None:
        pytest.skip(reason)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        from playwright.sync_api import sync_playwright  # noqa: PLC0415

    with sync_playwright() as playwright:
        executable = next(filter(None, map(shutil.which, NAMES)))
        browser = playwright.chromium.launch(executable_path=executable, args=FLAGS)
        yield browser
        browser.close()
