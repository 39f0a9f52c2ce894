"""The labs run in a tab: programs, their errors, the checks, and a page without any network."""

import datetime
import functools
import http.server
import threading
from pathlib import Path

import pytest

from taskrpc.core.security.tls import Tls
from taskrpc.course.browser_lab import server as server_module
from taskrpc.course.browser_lab.downloads import runtime
from taskrpc.course.browser_lab.server import LabServer
from taskrpc.course.browser_lab.site import site_files, write_site
from taskrpc.course.classroom.authority import make_certificates
from taskrpc.course.labs.catalogue import lab
from taskrpc.course.labs.starter import filled
from taskrpc.course.labs.variants import Variant
from tests.browser.chromium import LAPTOP, PATIENCE, Tabs
from tests.browser.legible import SCHEMES, SIZES, all_faults, faults
from tests.javascript.pyodide import archives
from tests.labs.submissions import solution_of

SOLUTION = Path(__file__).parents[2] / "examples" / "labs" / "lab1" / "solution"
LONG = 120
"""Seconds until Python is loaded, which the browser compiles first, or until a check has ended."""
SCROLLED = "#editor, #output_panel .scroll"
"""What a reader of the page scrolls on purpose."""

ASYNC_SERVER = """
import srvgen, taskrpc
AddTwoInts = srvgen.load("example_interfaces/srv/AddTwoInts")
async def add(request, response):
    response.sum = request.a + request.b
    print(request.a, request.b, flush=True)
    return response
async def main():
    async with taskrpc.Node("add_server") as node:
        node.create_service(AddTwoInts, "add_two_ints", add)
        await node.spin()
taskrpc.run(main())
"""

POOL = """
import threading, time
import rclpy
from rclpy.executors import MultiThreadedExecutor
from example_interfaces.srv import AddTwoInts

def add(request, response):
    time.sleep(0.1)
    response.sum = request.a + request.b
    return response

rclpy.init()
node = rclpy.create_node("pool")
node.create_service(AddTwoInts, "add", add)
client = node.create_client(AddTwoInts, "add")
executor = MultiThreadedExecutor(4)
executor.add_node(node)
threading.Thread(target=executor.spin, daemon=True).start()
client.wait_for_service()
print("the sum is", client.call(AddTwoInts.Request(a=10, b=1)).sum)
rclpy.shutdown()
"""


class LabPage:
    """The page in a tab."""

    def __init__(self, tab, *, state="Ready"):
        self.tab = tab
        self.waits_for_state(state, LONG)

    def waits_for_state(self, words, patience=PATIENCE):
        self.tab.wait(lambda: self.tab.text("#state") == words, f"the state {words}", patience)

    def show(self, number, version="rclpy"):
        """Choose a lab and its version."""
        self.tab.run("page.open(arguments[0]); page.open_version(arguments[1])", number, version)

    def write(self, file, text):
        """Replace the text of a file, as a student does."""
        self.tab.click(f'[data-file="{file}"]')
        self.tab.run(
            "const area = document.getElementById('code'); area.value = arguments[0];"
            "area.dispatchEvent(new Event('input', {bubbles: true}))",
            text,
        )

    def write_solution(self):
        for file in ("server.py", "client.py"):
            text = (SOLUTION / file).read_text(encoding="utf-8")
            self.write(file, text.replace("@SERVICE@", "add_two_ints"))

    def lines(self):
        return [line.replace("\n", " ") for line in self.tab.texts("#output li")]

    def waits_for_line(self, *words):
        def found():
            lines = self.lines()
            return [line for line in lines if all(word in line for word in words)]

        return self.tab.wait(found, f"a line with {words}")[0]

    def check(self):
        """Press Check; returns the texts of the findings."""
        self.tab.click("#check")
        self.tab.wait(lambda: self.tab.all("#findings .total"), "the end of the check", LONG)
        return self.tab.texts("#findings li")


@pytest.fixture(scope="module")
def files():
    return site_files(runtime(archives(), print))


@pytest.fixture(scope="module")
def lab_server(files):
    with LabServer(files, 0) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield server
        server.shutdown()
        thread.join()


@pytest.fixture
def class_server(files, tmp_path):
    """The page as `taskrpc classroom lab` serves it."""
    now = datetime.datetime.now(datetime.UTC)
    made = make_certificates(tmp_path, ["127.0.0.1"], now)
    context = Tls(cert=made.cert, key=made.key).server_context()
    with LabServer(files, 0, context=context) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        yield server
        server.shutdown()
        thread.join()


@pytest.fixture(scope="module")
def shared_tabs(browser):
    with Tabs(browser) as tabs:
        yield tabs


@pytest.fixture(scope="module")
def shared_page(shared_tabs, lab_server):
    """One page for most tests: it has the next Python ready when a test needs one."""
    return LabPage(shared_tabs.open(lab_server.url))


@pytest.fixture
def page(shared_tabs, shared_page):
    """The page with the starter files of lab 1; its next run begins in a new Python."""
    tab = shared_page.tab
    tab.run("localStorage.clear()")
    tab.size(*LAPTOP)
    tab.prefer()
    shared_page.show(1)
    yield shared_page
    tab.run("localStorage.clear()")
    assert shared_tabs.problems() == []


def test_server_and_client_of_lab_1_run_together_and_pass_the_check(page):
    page.write_solution()
    page.tab.click("#run")
    page.waits_for_line("client", "2 + 3 = 5")
    page.waits_for_line("client", "ended")
    page.waits_for_state("1 program runs")
    page.tab.click("#stop")
    page.waits_for_line("server", "ended")
    assert page.check()[-1] == "All 5 checks passed."


@pytest.mark.parametrize("number", [2, 3])
def test_solutions_of_the_other_labs_pass_the_check(page, number):
    page.show(number)
    source, values = solution_of(number), lab(number).values(Variant())
    for path in (each for each in sorted(source.rglob("*")) if each.is_file()):
        name = filled(path.relative_to(source).as_posix(), values)
        page.write(name, filled(path.read_text(encoding="utf-8"), values))
    assert page.check()[-1] == f"All {len(lab(number).checks)} checks passed."


def test_a_wrong_program_gets_a_message_that_can_be_read_and_says_what_was_expected(page):
    page.write_solution()
    text = (SOLUTION / "server.py").read_text(encoding="utf-8").replace("@SERVICE@", "add_two_ints")
    page.write("server.py", text.replace("        return response\n", ""))
    findings = page.check()
    failed = next(text for text in findings if "expected" in text)
    assert "a response of /add_two_ints to a=2 b=3" in failed
    assert "passed." in findings[-1]
    for size, pixels in SIZES.items():
        page.tab.size(*pixels)
        found = faults(page.tab, SCROLLED)
        assert not found, "\n".join([size, *found])


def test_a_traceback_shows_only_the_lines_of_the_student(page):
    page.write("server.py", "import rclpy\n\nrclpy.create_node('a b')\n")
    page.write("client.py", "print('fine')\n")
    page.tab.click("#run")
    page.waits_for_line("server", "ended with exit code 1")
    places = [line for line in page.lines() if "File " in line]
    assert len(places) == 1
    assert 'File "server.py", line 3' in places[0]


def test_a_program_with_a_pool_of_threads_ends_and_the_others_run_on(page):
    page.write("server.py", POOL)
    page.write("client.py", "import time\nfor n in range(9): print(n); time.sleep(0.3)\n")
    page.tab.click("#run")
    page.waits_for_line("server", "the sum is 11")
    page.waits_for_line("server", "ended")
    page.waits_for_line("client", "8")
    page.waits_for_line("client", "ended")
    assert not [line for line in page.lines() if "Error" in line or "Traceback" in line]


def test_an_endless_loop_can_be_stopped_and_the_page_works_on(page):
    page.write("server.py", "print('begin', flush=True)\nwhile True:\n    pass\n")
    page.write("client.py", "print('fine')\n")
    page.tab.click("#run")
    page.waits_for_line("server", "begin")
    page.tab.click("#stop")
    page.waits_for_line("page", "computes without ever waiting")
    page.write("server.py", "print('again')\n")
    page.waits_for_state("Ready", LONG)
    page.tab.wait(lambda: page.tab.all("#run:enabled"), "Run to be enabled")
    page.tab.click("#run")
    page.waits_for_line("server", "again")


def test_a_reload_keeps_the_programs_until_the_student_starts_again_also_without_python(
    tabs, lab_server
):
    code = "return document.getElementById('code')?.value"
    tab = tabs.open("about:blank")
    tab.command("Network.enable")
    tab.command("Network.setBlockedURLs", urls=["*/pyodide.asm.wasm"])  # Python takes long to load
    tabs.expect("pyodide.asm.wasm", "Failed to fetch")
    tab.open(f"{lab_server.url}?lab=2")
    page = LabPage(tab, state="Python could not be loaded")
    assert tab.run("return document.getElementById('lab').value") == "2"
    starter = tab.run(code)
    page.write(tab.run("return page.file"), "# mine\n")
    tab.open(tab.url)
    page.waits_for_state("Python could not be loaded")
    assert tab.run(code) == "# mine\n"
    tab.click("#reset")
    tab.click("#reset_yes")
    assert tab.run(code) == starter


def test_the_robot_drives_to_a_click_on_the_map(page):
    page.tab.find("#robot:not([hidden])")
    before = page.tab.text("#pose")
    page.tab.run(
        "const box = document.getElementById('map').getBoundingClientRect();"
        "document.getElementById('map_drawing').dispatchEvent(new MouseEvent('click',"
        " {clientX: box.x + box.width * .3, clientY: box.y + box.height * .6, bubbles: true}))"
    )
    page.tab.wait(lambda: page.tab.text("#pose") != before, "the robot to move")


# The frames for which the page asks while sixty are drawn.
_ASKED = """
    let asked = 0;
    const next = requestAnimationFrame;
    globalThis.requestAnimationFrame = drawn => { asked += 1; return next(drawn); };
    for (let i = 0; i < 60; i++) await new Promise(next);
    globalThis.requestAnimationFrame = next;
    return asked;
"""


def test_page_that_nobody_uses_does_not_draw_each_frame(page):
    assert page.tab.run_async(_ASKED) < 30


def test_the_page_is_accessible_and_each_lab_can_be_read(page):
    for theme in SCHEMES:
        page.tab.prefer(color_scheme=theme)
        assert page.tab.violations() == [], theme
    found = []
    for version in ("rclpy", "async"):
        for number in (1, 2, 3):
            page.show(number, version)
            found += all_faults(page.tab, f"lab {number}", version, scrolled=SCROLLED)
    assert not found, "\n".join(found)


def test_without_jspi_and_network_a_static_server_offers_the_asynchronous_lab(
    tabs, files, tmp_path
):
    write_site(tmp_path, files)

    class Handler(http.server.SimpleHTTPRequestHandler):
        def log_message(self, *_):
            pass

    handler = functools.partial(Handler, directory=str(tmp_path))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        try:
            page = LabPage(tabs.open(f"http://127.0.0.1:{server.server_port}/?async"))
            assert "Chromium from version 137" in page.tab.text("#banner")
            assert "async def main" in page.tab.run("return document.getElementById('code').value")
            page.write("server.py", ASYNC_SERVER)
            starter = page.tab.run("return page.files.starter('client.py')")
            page.write(
                "client.py",
                starter.replace(
                    "        # 7.",
                    "        await client.wait_for_service()\n        response = await"
                    " client.call(AddTwoInts.Request(a=a, b=b))\n        # 7.",
                ),
            )
            findings = page.check()
            assert findings[-1] == "All 5 checks passed.", findings
            page.tab.click("#run")
            page.waits_for_line("client", "2 + 3 = 5")
        finally:
            server.shutdown()
            thread.join()


def test_a_class_with_an_accepted_certificate_loads_the_large_files_once(
    tabs, class_server, monkeypatch
):
    """A browser keeps no file of such a site, and each run begins in a new worker."""
    sent = []
    monkeypatch.setattr(
        server_module._Handler, "log_request", lambda self, *_: sent.append(self.path)
    )
    page = LabPage(tabs.open(class_server.url, any_certificate=True))
    for number in range(2):
        page.write("server.py", f"print('run {number}')\n")
        page.write("client.py", "")
        page.tab.click("#run")
        page.waits_for_line("server", f"run {number}")
        page.waits_for_state("Ready", LONG)
    loaded = [path for path in sent if path.endswith((".wasm", ".zip", ".whl", ".json"))]
    assert "/pyodide/pyodide.asm.wasm" in loaded
    assert sorted(loaded) == sorted(set(loaded))
    page.tab.run("localStorage.clear()")
