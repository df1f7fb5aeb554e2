"""The headless Chromium of the app's browser tests, for benchmarks that measure in one."""

from tests.app.browser.conftest import chromium  # noqa: F401 (a fixture)
