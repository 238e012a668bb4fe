"""The live page: who can reach it, what a changed file does, and how it ends. The browser is real Chromium."""

import contextlib
import hashlib
import http.client
import itertools
import os
import queue
import re
import signal
import socket
import subprocess
import sys
import threading
import time
import webbrowser
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path
from types import SimpleNamespace

import psutil
import pytest
from playwright.sync_api import Page

from outputs.view_cases import arm_model, arm_text, made_up_errors
from precision_pin.base.errors import Finding, InputError, OutputError, SheetError
from precision_pin.pages.view import ViewPose, page
from precision_pin.pages.view.live import serve
from support.browser import complaints, needs_chromium, outside_requests, visited
from support.waiting import eventually

HOSTILE = "</title><script>document.title = 'owned'</script><img src=x onerror=alert(1)>\u202e"


def small_page(text: str) -> str:
    return f"<!DOCTYPE html><title>page {text}</title><h1>{text}</h1>"


@dataclass
class Sheet:
    """A file that is the page's text; one with ``wrong`` in it is refused."""

    path: Path
    make: Callable[[str], str] = small_page
    made: int = 0

    def page(self) -> str:
        self.made += 1
        try:
            text = self.path.read_text("utf-8")
        except OSError as problem:
            raise SheetError(f"cannot read it: {problem.strerror}") from None
        if "wrong" in text:
            found = (("E_SHEET", f"no source named {HOSTILE}", 3), ("E_UNIT", "a length has the unit kg", 7))
            raise SheetError([Finding("error", code, said, "arm.yaml", line) for code, said, line in found])
        return self.make(text)


@dataclass
class Served:
    """A server at work in another thread."""

    port: int
    lines: queue.Queue[str]
    stop: threading.Event = field(default_factory=threading.Event)

    @property
    def address(self) -> str:
        return f"http://127.0.0.1:{self.port}/"

    def get(self, path: str, method: str = "GET", **headers: str) -> tuple[int, dict[str, str], bytes]:
        with contextlib.closing(http.client.HTTPConnection("127.0.0.1", self.port, timeout=5)) as connection:
            connection.request(method, path, headers=headers)
            answer = connection.getresponse()
            return answer.status, dict(answer.getheaders()), answer.read()

    def raw(self, request: bytes) -> bytes:
        with socket.create_connection(("127.0.0.1", self.port), timeout=5) as connection:
            connection.sendall(request)
            connection.shutdown(socket.SHUT_WR)
            return b"".join(iter(lambda: connection.recv(65536), b""))

    def line(self) -> str:
        return self.lines.get(timeout=5)


OF_BROWSER = "asyncio-waitpid"
"""Thread that waits for the browser, which the tests of this file share."""


@contextlib.contextmanager
def serving(
    make_page: Callable[[], str], *watched: Path, port: int = 0, open_browser: bool = False
) -> Iterator[Served]:
    before = set(threading.enumerate())
    lines: queue.Queue[str] = queue.Queue()
    stop = threading.Event()

    def tick() -> None:
        if stop.is_set():
            raise KeyboardInterrupt

    thread = threading.Thread(
        target=lambda: serve(make_page, watched, port=port, open_browser=open_browser, announce=lines.put, tick=tick)
    )
    thread.start()
    try:
        address = lines.get(timeout=5)
        found = re.fullmatch(r"http://127\.0\.0\.1:(\d+)/", address)
        assert found, address
        yield Served(int(found[1]), lines, stop)
    finally:
        stop.set()
        thread.join(timeout=5)
    assert not thread.is_alive()
    assert eventually(lambda: {one for one in threading.enumerate() if not one.name.startswith(OF_BROWSER)} <= before)


@pytest.fixture
def sheet(tmp_path: Path) -> Sheet:
    path = tmp_path / "arm.yaml"
    path.write_text("one", "utf-8")
    return Sheet(path)


@pytest.fixture
def served(sheet: Sheet) -> Iterator[Served]:
    with serving(sheet.page, sheet.path) as running:
        yield running


@pytest.fixture(scope="module")
def steady() -> Iterator[Served]:
    """Serve a page of no file, to many tests."""
    with serving(lambda: small_page("steady")) as running:
        yield running


def reachable(address: str, port: int) -> bool:
    try:
        socket.create_connection((address, port), timeout=1).close()
    except OSError:
        return False
    return True


# who can reach it


def test_it_listens_on_the_loopback_address_and_no_other(served):
    assert reachable("127.0.0.1", served.port)
    here = itertools.chain.from_iterable(psutil.net_if_addrs().values())
    others = {one.address for one in here if one.family in (socket.AF_INET, socket.AF_INET6)} | {"::1", "127.0.0.2"}
    assert [address for address in others - {"127.0.0.1"} if reachable(address, served.port)] == []


KEPT_OUT = {
    "Cache-Control": "no-store",
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
}


def test_the_three_paths_answer_with_headers_that_keep_others_out(steady):
    for path in ("/", "/page", "/version", "/page?0123", "/version?now"):
        status, headers, body = steady.get(path)
        assert status == 200
        assert body
        assert KEPT_OUT.items() <= headers.items()
        assert int(headers["Content-Length"]) == len(body)
        assert headers["Content-Type"] == f"text/{'plain' if 'version' in path else 'html'}; charset=utf-8"
        framed_by = "self" if path.startswith("/page") else "none"
        assert headers["Content-Security-Policy"].endswith(f"frame-ancestors '{framed_by}'")
        assert "Python" not in str(headers)
        head = steady.get(path, "HEAD")
        assert (head[0], head[1]["Content-Length"], head[2]) == (200, headers["Content-Length"], b"")
        request = f"HEAD {path} HTTP/1.0\r\nHost: 127.0.0.1:{steady.port}\r\n\r\n"
        assert steady.raw(request.encode()).endswith(b"\r\n\r\n")


def test_a_wrong_host_is_refused_in_plain_words(served, sheet):
    port = served.port
    assert served.get("/page", Host=f"LOCALHOST:{port}")[2].decode("utf-8") == small_page("one")
    assert sheet.made == 1
    for host in ("evil.example", "127.0.0.1", f"127.0.0.1:{port + 1}", f"127.0.0.2:{port}", f"[::1]:{port}",
                 f"127.0.0.1.evil.example:{port}", f"127.0.0.1:{port}, evil.example", f"user@127.0.0.1:{port}", ""):  # fmt: skip
        for path in ("/page", "/version", "/nothing"):
            status, headers, body = served.get(path, Host=host)
            assert (status, body.decode()) == (403, f"403 open {served.address}\n")
            assert (KEPT_OUT | {"Content-Type": "text/plain; charset=utf-8"}).items() <= headers.items()
    twice = f"GET /page HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nHost: evil.example\r\n\r\n"
    for request in (b"GET /page HTTP/1.0\r\n\r\n", twice.encode()):
        assert served.raw(request).startswith(b"HTTP/1.0 403 ")


def test_every_other_path_and_method_is_refused(steady):
    for path in ("/page/", "/page/..", "/../../etc/passwd", "/%2e%2e/etc/passwd", "/arm.yaml", "//page/x", "/PAGE",
                 "/p%61ge", "page", "http://127.0.0.1/page", "http://[/", "/<script>", "*"):  # fmt: skip
        status, headers, body = steady.get(path, Host=f"127.0.0.1:{steady.port}")
        assert (status, body) == (404, b"404 Not Found\n")
        assert KEPT_OUT.items() <= headers.items()
    for method in ("POST", "PUT", "DELETE", "OPTIONS", "PATCH", "TRACE", "CONNECT"):
        status, headers, body = steady.get("/page", method)
        assert (status, b"<" in body) == (501, False)
        assert KEPT_OUT.items() <= headers.items()


def test_broken_requests_and_readers_who_leave_are_nothing_to_it(served, capfd):
    many = b"GET / HTTP/1.0\r\n" + b"x: y\r\n" * 200
    for request in (b"\0\xff\r\n", b"GET / HTTP/9.9\r\n", b"GET /" + b"a" * 70_000 + b" HTTP/1.0\r\n", many):
        served.raw(request + b"\r\n")
    with socket.create_connection(("127.0.0.1", served.port)) as hasty:
        hasty.setsockopt(socket.SOL_SOCKET, socket.SO_LINGER, b"\1\0\0\0\0\0\0\0")
        hasty.sendall(b"GET /page HTTP/1.0\r\n")
    with socket.create_connection(("127.0.0.1", served.port)):
        # silent: its thread waits, and still is no hindrance, nor left over at the end
        assert served.get("/page")[0] == 200
    assert capfd.readouterr() == ("", "")


# what a changed file does


def replaced(path: Path, text: str) -> None:
    other = path.with_suffix(".new")
    other.write_text(text, "utf-8")
    other.replace(path)


def rewritten_with_the_same_stamp(path: Path, text: str) -> None:
    before = path.stat()
    assert len(text) == before.st_size
    path.write_text(text, "utf-8")
    os.utime(path, ns=(before.st_atime_ns, before.st_mtime_ns))


def test_a_change_is_seen_however_it_is_written_and_a_touch_is_none(served, sheet):
    version = served.get("/version")[2]
    os.utime(sheet.path, (1e9, 1e9))
    time.sleep(0.6)
    assert (sheet.made, served.get("/version")[2]) == (1, version)
    for write, text in ((replaced, "two"), (rewritten_with_the_same_stamp, "six")):
        write(sheet.path, text)
        begun = time.monotonic()
        assert served.line() == "the files have changed; the page was rebuilt"
        assert time.monotonic() - begun < 3
        assert served.get("/page")[2].decode() == small_page(text)
        assert served.get("/version")[2] != version
        version = served.get("/version")[2]


@pytest.mark.slow
def test_coarse_stamps_hide_no_change(tmp_path, monkeypatch):
    genuine, begun = Path.stat, time.time_ns()

    def coarse(self, **more):
        found = genuine(self, **more)
        kept = {name: getattr(found, name) for name in ("st_mode", "st_ino", "st_size")}
        return SimpleNamespace(**kept, st_mtime_ns=begun, st_ctime_ns=begun)

    monkeypatch.setattr(Path, "stat", coarse)
    path = tmp_path / "arm.yaml"
    path.write_text("one", "utf-8")
    with serving(lambda: path.read_text("utf-8"), path) as running:
        path.write_text("two", "utf-8")
        assert running.line().startswith("the files have changed")


@pytest.mark.slow
def test_a_file_in_the_middle_of_being_written_is_left_alone(served, sheet, monkeypatch):
    genuine, waits = hashlib.file_digest, itertools.cycle((0.3, 0.0))

    def held_up(*given):
        time.sleep(next(waits))
        return genuine(*given)

    monkeypatch.setattr(hashlib, "file_digest", held_up)
    enough = threading.Event()

    def ask() -> None:
        while not enough.wait(0.01):
            served.get("/version")  # wakes the server, as a browser does

    asking = threading.Thread(target=ask)
    asking.start()
    # of a writer that the machine stopped for longer than the server waits, a half would rightly be read: try again
    for number in range(5):
        before, longest, ended = sheet.made, 0.0, time.monotonic()
        with sheet.path.open("r+b", buffering=0) as stream:  # emptied before each part, the file would look alike
            for part in range(70):
                os.pwrite(stream.fileno(), f"half {number} {part:02d}".encode(), 0)
                time.sleep(0.02)
                made, began, ended = sheet.made, ended, time.monotonic()
                longest = max(longest, ended - began)
        if longest < 0.2:
            break
        time.sleep(1.5)
        while not served.lines.empty():
            served.line()
    enough.set()
    asking.join()
    assert made == before
    assert served.line().startswith("the files have changed")
    assert (sheet.made, served.get("/page")[2].decode()) == (before + 1, small_page(f"half {number} 69"))


@pytest.mark.slow
def test_a_change_while_the_page_is_made_is_not_lost(tmp_path):
    path = tmp_path / "arm.yaml"
    path.write_text("one", "utf-8")
    made = []

    def slow() -> str:
        text = path.read_text("utf-8")
        made.append(text)
        if text != "three":
            path.write_text({"one": "two", "two": "three"}[text], "utf-8")
        return small_page(text)

    with serving(slow, path) as running:
        assert eventually(lambda: running.get("/page")[2].decode() == small_page("three"))
    assert made == ["one", "two", "three"]


def test_what_is_wrong_is_announced_and_shown_as_text_until_it_is_right(served, sheet):
    sheet.path.write_text("wrong", "utf-8")
    lines = [line.split(": ")[:2] for line in served.line().splitlines()]
    assert lines == [["arm.yaml:3", "error E_SHEET"], ["arm.yaml:7", "error E_UNIT"]]
    status, _, body = served.get("/page")
    text = body.decode("utf-8")
    assert status == 200
    assert not re.search("<script|<img|\u202e", text)
    assert "arm.yaml:3: error E_SHEET: no source named &lt;/title&gt;&lt;script&gt;" in text
    assert "arm.yaml:7: error E_UNIT: a length has the unit kg" in text
    sheet.path.unlink()
    assert served.line() == "precision-pin: error E_SHEET: cannot read it: No such file or directory"
    assert b"No such file or directory" in served.get("/page")[2]
    sheet.path.write_text("back", "utf-8")
    assert served.line().startswith("the files have changed")
    assert served.get("/page")[2].decode() == small_page("back")


def test_the_first_page_must_come_out_right(sheet):
    sheet.path.write_text("wrong", "utf-8")
    announced = []
    with pytest.raises(SheetError, match="a length has the unit kg"):
        serve(sheet.page, [sheet.path], open_browser=False, announce=announced.append)
    assert announced == []


@pytest.mark.slow
@pytest.mark.parametrize("problem", [ZeroDivisionError, KeyboardInterrupt])
def test_a_bug_or_ctrl_c_while_the_page_is_made_ends_the_server_and_frees_the_port(tmp_path, problem):
    path = tmp_path / "arm.yaml"
    path.write_text("one", "utf-8")
    announced = []

    def make_page() -> str:
        if announced:
            raise problem
        return "page"

    with contextlib.nullcontext() if problem is KeyboardInterrupt else pytest.raises(problem):
        serve(make_page, [path], open_browser=False, announce=announced.append, tick=lambda: path.write_text("two"))
    assert not reachable("127.0.0.1", int(announced[0].rstrip("/").rpartition(":")[2]))


# in the browser


def await_text(page: Page, selector: str, text: str) -> None:
    """Wait until the first such element in the frame has the text; the frame may be loaded anew meanwhile."""
    page.wait_for_function(
        """([selector, text]) =>
          document.getElementById("page").contentDocument?.querySelector(selector)?.textContent === text""",
        arg=[selector, text],
        polling=50,
        timeout=10_000,
    )


@pytest.mark.slow
@needs_chromium
def test_the_browser_follows_the_file_through_an_error_and_keeps_what_was_set(browser, sheet, tmp_path):
    shown = [ViewPose(at, made_up_errors(50)) for at in map(arm_model(tmp_path, arm_text()).at, "pq")]
    sheet.make = lambda text: page(shown, title=text, seed=1, model_name="exact", factor=20.0)
    with serving(sheet.page, sheet.path) as served:
        visit = visited(browser, served.address + "#factor=50&look=tip&pose=2")
        frame = visit.page.frame_locator("#page")

        def await_page(title: str, **expected: str) -> None:
            await_text(visit.page, "h1", title)
            frame.locator("body[data-ready]").wait_for()
            assert visit.page.title() == title
            state = frame.locator("body").evaluate("(body) => ({ ...body.dataset })")
            assert float(state["factor"]) == pytest.approx(float(expected["factor"]), rel=1e-6)
            assert (state["look"], state["pose"]) == (expected["look"], expected["pose"])

        await_page("one", factor="50", look="tip", pose="2")
        frame.locator("body").evaluate(
            """() => {
              for (const [id, value] of [["pose", 0], ["factor", Math.log10(150)]]) {
                const slider = document.getElementById(id);
                slider.value = value;
                slider.dispatchEvent(new Event("input"));
              }
              document.getElementById("look-arm").click();
              window.mark = "kept";
            }"""
        )
        time.sleep(0.7)
        assert frame.locator("body").evaluate("() => window.mark") == "kept"  # nothing changed, nothing is loaded again
        sheet.path.write_text("two", "utf-8")
        await_page("two", factor="150", look="arm", pose="1")
        sheet.path.write_text("wrong", "utf-8")
        await_text(visit.page, "h1", "The page cannot be made")
        assert visit.page.title() == "The page cannot be made"
        assert frame.locator("img, script").count() == 0
        replaced(sheet.path, "three")
        await_page("three", factor="150", look="arm", pose="1")
        assert visit.page.evaluate("history.length") <= 2  # the reader's way back is not filled with versions
        assert complaints(visit) == []
        assert all(url.startswith(served.address) for url in outside_requests(visit))
        assert visit.page.locator("#ended").is_hidden()
        served.stop.set()
        visit.page.locator("#ended").wait_for(state="visible", timeout=5_000)
        assert "The server has ended" in visit.page.locator("#ended").inner_text()
        await_text(visit.page, "h1", "three")


# how it begins and ends


def test_a_browser_is_opened_and_may_take_its_time(monkeypatch, sheet):
    asked, until = queue.Queue(), threading.Event()
    browser = SimpleNamespace(name="firefox", open=lambda address: (asked.put(address), until.wait(20)))
    monkeypatch.setattr(webbrowser, "get", lambda: browser)
    with serving(sheet.page):
        time.sleep(0.2)
    assert asked.empty()  # none was wanted
    with serving(sheet.page, open_browser=True) as running:
        assert asked.get(timeout=5) == running.address
        assert running.get("/page")[0] == 200
        until.set()


@pytest.mark.parametrize(
    "problem", [webbrowser.Error("could not locate runnable browser"), OSError(2, "No file"), None]
)
def test_no_browser_or_one_for_the_terminal_is_no_error(monkeypatch, sheet, problem):
    asked = threading.Event()

    def get() -> SimpleNamespace:
        asked.set()
        if problem is not None:
            raise problem
        return SimpleNamespace(name="/usr/bin/w3m", open=pytest.fail)

    monkeypatch.setattr(webbrowser, "get", get)
    with serving(sheet.page, open_browser=True) as running:
        assert asked.wait(5)
        assert running.get("/page")[0] == 200


def test_a_port_in_use_is_one_line_that_says_what_is_allowed(served, sheet):
    made = sheet.made
    with pytest.raises(OutputError) as caught:
        serve(sheet.page, port=served.port, open_browser=False, announce=pytest.fail)
    assert str(caught.value) == (
        f"precision-pin: error E_OUTPUT: cannot serve on port {served.port}: Address already in use; "
        "give 0 for any free port, or one of 1024 to 65535"
    )
    assert sheet.made == made


def test_a_port_that_does_not_exist_or_is_reserved_is_refused():
    for port in (-1, 1023, 65536, 10**30, True, 8000.0, "8000", None):
        with pytest.raises(InputError, match=r"or one of 1024 to 65535$") as caught:
            serve(pytest.fail, port=port, announce=pytest.fail)
        assert "\n" not in str(caught.value)


PROGRAM = """
import sys
from precision_pin.pages.view.live import serve

serve(lambda: "page", [], open_browser=False, announce=lambda line: print(line, file=sys.stderr, flush=True))
print("after", flush=True)
"""


@pytest.mark.slow
def test_ctrl_c_ends_it_at_once_and_the_port_can_be_used_again(sheet):
    process = subprocess.Popen(
        [sys.executable, "-c", PROGRAM], stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True
    )
    try:
        port = int(process.stderr.readline().strip().rstrip("/").rpartition(":")[2])
        with (
            socket.create_connection(("127.0.0.1", port)) as silent,
            socket.create_connection(("127.0.0.1", port)) as half,
        ):
            half.sendall(b"GET /page HTTP/1.0\r\nHost: ")
            connection = http.client.HTTPConnection("127.0.0.1", port, timeout=5)
            connection.request("GET", "/page")
            assert connection.getresponse().read() == b"page"
            connection.close()
            assert psutil.Process(process.pid).children(recursive=True) == []
            begun = time.monotonic()
            process.send_signal(signal.SIGINT)
            out, err = process.communicate(timeout=10)
            assert time.monotonic() - begun < 5  # a silent connection lasts twice as long
            assert silent.recv(1) == b""
        assert (process.returncode, out, err) == (0, "after\n", "")
        assert not reachable("127.0.0.1", port)
        with serving(sheet.page, port=port) as again:
            assert again.port == port
    finally:
        process.kill()
        process.communicate()
