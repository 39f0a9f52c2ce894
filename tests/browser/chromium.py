"""A headless Chromium, controlled by selenium, that reports everything that a page does wrong."""

from __future__ import annotations

import contextlib
import json
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, TypeVar

from selenium import webdriver
from selenium.common.exceptions import StaleElementReferenceException
from selenium.webdriver.chrome.service import Service
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.by import By
from selenium.webdriver.remote.webelement import WebElement

from tests.javascript.packages import node_modules, program

PATIENCE = 20
"""Seconds until a condition must hold; far more than it takes."""

LAPTOP = (1280, 720)
"""Width and height in pixels; a projector often has as many."""
PHONE = (390, 844)

# Runs in each document before its own scripts.
_WATCH = """
globalThis.reported = [];
addEventListener("securitypolicyviolation", event => reported.push(
    `policy: ${event.violatedDirective} blocked ${event.blockedURI || "inline"}` +
    ` at ${event.sourceFile}:${event.lineNumber}`));
addEventListener("unhandledrejection", event => reported.push(`rejected: ${event.reason}`));
"""
_TAKE = "const all = globalThis.reported ?? []; globalThis.reported = []; return all"

_Value = TypeVar("_Value")


class Browser(webdriver.Chrome):
    """A browser that selects a tab only if another one is selected, and keeps empty tabs."""

    selected = ""
    """The handle of the tab that the commands are for."""
    empty: list[str]
    """The handles of the tabs that earlier tests have left."""

    def select(self, handle: str) -> None:
        """Send the next commands to a tab."""
        if self.selected != handle:
            self.switch_to.window(handle)
            self.selected = handle


@contextlib.contextmanager
def chromium(*arguments: str) -> Iterator[Browser]:
    """Start a headless Chromium with additional arguments, and end it."""
    options = webdriver.ChromeOptions()
    options.binary_location = program(
        "chromium", "chromium-browser", "google-chrome", package="chromium"
    )
    driver = program("chromedriver", package="chromium-driver")
    for argument in (
        "--headless=new",
        "--no-sandbox",  # needed where the tests run as root
        "--disable-dev-shm-usage",  # containers have a small /dev/shm
        "--hide-scrollbars",
        # No page may need another machine.
        "--host-resolver-rules=MAP * ~NOTFOUND, EXCLUDE 127.0.0.1, EXCLUDE localhost",
        "--force-color-profile=srgb",
        "--disable-background-timer-throttling",
        "--disable-renderer-backgrounding",
        "--disable-backgrounding-occluded-windows",
        # Processes for pages that nobody opens or returns to take longer to start than most tests.
        "--disable-features="
        "BackForwardCache,ProactivelySwapBrowsingInstance,SpareRendererForSitePerProcess",
        f"--window-size={LAPTOP[0]},{LAPTOP[1]}",
        *arguments,
    ):
        options.add_argument(argument)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    browser = Browser(options=options, service=Service(driver))
    browser.set_script_timeout(60)
    browser.empty = []
    try:
        yield browser
    finally:
        browser.quit()


class Tabs:
    """Opens tabs, and collects the errors and warnings of all of them; empties them at its end."""

    def __init__(self, browser: Browser) -> None:
        self._browser = browser
        self._first = browser.window_handles[0]
        browser.select(self._first)
        self._open: list[Tab] = []
        self._expected: list[str] = []
        self._reports: list[str] = []
        browser.get_log("browser")  # of earlier tests

    def __enter__(self) -> Tabs:
        return self

    def __exit__(self, *_: object) -> None:
        for tab in self._open:
            tab.leave()
        self._browser.select(self._first)

    def open(
        self,
        url: str,
        *,
        size: tuple[int, int] = LAPTOP,
        any_certificate: bool = False,
        **preferred: str,
    ) -> Tab:
        """Load a page in a new tab; `preferred` are media features as of `Tab.prefer`.

        `any_certificate`: the user has accepted the certificate of which the browser warns.
        """
        tab = Tab(self._browser, self._reports)
        self._open.append(tab)
        tab.command("Security.setIgnoreCertificateErrors", ignore=any_certificate)
        tab.size(*size)
        tab.prefer(**preferred)
        tab.open(url)
        return tab

    def expect(self, *words: str) -> None:
        """Accept reports that contain these words: a test that ends a server causes some."""
        self._expected += words

    def problems(self) -> list[str]:
        """Return the unexpected errors, warnings and policy reports since the last time."""
        for tab in self._open:
            tab.report()
        reports, self._reports[:] = list(self._reports), []
        return [each for each in reports if not any(words in each for words in self._expected)]


class Tab:
    """One tab. Each method selects it first. An element is named by a CSS selector."""

    def __init__(self, browser: Browser, reports: list[str]) -> None:
        self._browser = browser
        self._reports = reports
        self._is_empty = True
        if browser.empty:  # a new one takes as long as most pages take to load
            self._handle = browser.empty.pop()
            return
        browser.switch_to.new_window("window")  # a tab would be hidden behind the next one
        self._handle = browser.selected = browser.current_window_handle
        self.command("Page.enable")
        self.command("Page.addScriptToEvaluateOnNewDocument", source=_WATCH)

    def open(self, url: str) -> None:
        """Load a page from the beginning, also if only the fragment of its URL differs."""
        self.report()
        if not self._is_empty:
            self._browser.get("about:blank")
        self._is_empty = False
        self._browser.get(url)
        # On a busy machine, chromedriver takes the end of the first page for that of the second.
        loaded = "return document.readyState === 'complete'"
        self.wait(lambda: self.run(loaded), f"{url} to be loaded")

    def leave(self) -> None:
        """Leave the page, and keep the empty tab for a later test."""
        self.run("try { sessionStorage.clear() } catch {}")  # some pages have none
        self.command("Network.disable")
        self._browser.get("about:blank")
        self._browser.empty.append(self._handle)

    @property
    def url(self) -> str:
        """What the address bar shows."""
        self._select()
        return self._browser.current_url

    # What the page looks like

    def size(self, width: int, height: int) -> None:
        """Give the page this many pixels; narrow pages behave as on a phone."""
        self.command(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=1,
            mobile=width < 600,
        )

    def prefer(self, **features: str) -> None:
        """Set media features, for example `color_scheme="dark"` or `reduced_motion="reduce"`."""
        named = [
            {"name": f"prefers-{name.replace('_', '-')}", "value": value}
            for name, value in features.items()
        ]
        self.command("Emulation.setEmulatedMedia", features=named)

    def picture(self, path: Path) -> None:
        """Write what the tab shows to a PNG file."""
        self._select()
        assert self._browser.save_screenshot(str(path))

    # Reading and acting

    def all(self, css: str) -> list[WebElement]:
        """Return the elements that match now."""
        self._select()
        return self._browser.find_elements(By.CSS_SELECTOR, css)

    def find(self, css: str) -> WebElement:
        """Return the first element that matches, as soon as there is one."""
        return self.wait(lambda: self.all(css), f"{css} to exist")[0]

    def texts(self, css: str) -> list[str]:
        """Return the visible text of each element that matches, read at one instant."""
        script = "return [...document.querySelectorAll(arguments[0])].map(e => e.innerText.trim())"
        return self.run(script, css)

    def text(self, css: str) -> str:
        """Return the visible text of the first element that matches, as soon as there is one."""
        return self.wait(lambda: self.texts(css), f"{css} to exist")[0]

    def shows(self, css: str) -> bool:
        """Return whether an element matches and can be seen."""
        return any(each.is_displayed() for each in self.all(css))

    def click(self, css: str) -> None:
        """Click the first element that matches, as soon as it can be clicked."""

        def clicked() -> bool:
            found = [each for each in self.all(css) if each.is_displayed() and each.is_enabled()]
            if found:
                found[0].click()
            return bool(found)

        self.wait(clicked, f"{css} to be clickable")

    def keys(self, *keys: str) -> None:
        """Press keys, in the element that has the focus."""
        self._select()
        for each in keys:
            ActionChains(self._browser).send_keys(each).perform()

    def run(self, script: str, *arguments: Any) -> Any:
        """Run JavaScript and return its value."""
        self._select()
        return self._browser.execute_script(script, *arguments)

    def run_async(self, body: str, *arguments: Any) -> Any:
        """Run the body of an async JavaScript function and return its value. Raises RuntimeError.

        The body gets the arguments as `args`.
        """
        self._select()
        script = f"""
            const args = [...arguments], done = args.pop();
            (async () => {{ {body} }})().then(
                value => done({{value}}), error => done({{error: `${{error.stack ?? error}}`}}));
        """
        result = self._browser.execute_async_script(script, *arguments)
        if "error" in result:
            raise RuntimeError(result["error"])
        return result.get("value")

    def wait(
        self, condition: Callable[[], _Value], words: str, patience: float = PATIENCE
    ) -> _Value:
        """Return the first true value of a condition. Fails if that takes too long."""
        ends = time.monotonic() + patience
        pause = 0.02  # grows: to look is expensive for the browser, too
        while True:
            with contextlib.suppress(StaleElementReferenceException):
                if value := condition():
                    return value
            if time.monotonic() > ends:
                break
            time.sleep(pause)
            pause = min(1.5 * pause, 0.25)
        shown = self.run("return document.body.innerText")
        raise AssertionError(f"waited {patience} s for {words}; the page shows:\n{shown}")

    def drawn(self) -> None:
        """Wait until the page shows what its scripts have changed, such as rows that now fit."""
        self.run_async(
            "await document.fonts.ready;"
            "await new Promise(done => requestAnimationFrame(() => requestAnimationFrame(done)))"
        )

    # What is wrong

    def violations(self) -> list[str]:
        """Return what axe-core finds: one line for each rule and element.

        Animations jump to their end first: the colours of a row that appears are no finding.
        """
        if not self.run("return typeof axe === 'object'"):
            source = (node_modules() / "axe-core" / "axe.min.js").read_text(encoding="utf-8")
            # The debugger may evaluate it: the page's policy allows scripts of the server only.
            self.command("Runtime.evaluate", expression=source)
        self.drawn()
        found = json.loads(
            self.run_async("""
                for (const each of document.getAnimations())
                    if (each.effect.getComputedTiming().endTime !== Infinity) each.finish();
                return JSON.stringify((await axe.run()).violations);
            """)
        )
        return [
            f"{rule['id']} ({rule['impact']}): {rule['help']}: {node['html'][:200]}"
            f" {node.get('failureSummary', '')}"
            for rule in found
            for node in rule["nodes"]
        ]

    def report(self) -> None:
        """Add what the page has reported since the last time to the reports of all tabs."""
        self._reports += self.run(_TAKE)
        self._reports += [
            f"{entry['level']} {entry['message']}"
            for entry in self._browser.get_log("browser")
            if entry["level"] in ("SEVERE", "WARNING")
        ]

    def _select(self) -> None:
        self._browser.select(self._handle)

    def command(self, name: str, **parameters: Any) -> Any:
        self._select()
        return self._browser.execute_cdp_cmd(name, parameters)
