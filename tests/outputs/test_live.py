"""The live page: who can reach it, what a changed file does, and how it ends. The browser is real Chromium."""

from __future__ import annotations

import base64
import contextlib
import hashlib
import http.client
import http.server
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
from playwright.sync_api import BrowserContext, Page

from outputs.view_cases import arm_text, made_up_errors
from precision_pin.base.errors import Finding, InputError, OutputError, SheetError
from precision_pin.draws.space import Space
from precision_pin.model.error_model import ErrorModel
from precision_pin.pages.view import ViewPose, page
from precision_pin.pages.view.live import serve
from precision_pin.robot.chain import Chain
from support.browser import chromium, complaints, needs_chromium, outside_requests, visited

HOSTILE = "</title><script>document.title = 'owned'</script><img src=x onerror=alert(1)>\u202e"
SCRIPT = """
  const wanted = new URLSearchParams(location.hash.slice(1));
  document.body.dataset.factor = wanted.get("factor") || "20";
  document.body.dataset.look = wanted.get("look") || "arm";
  document.body.dataset.pose = wanted.get("pose") || "1";
"""


def small_page(text: str) -> str:
    """Return a page with the policy of the real one, which reads its fragment as the real one does."""
    allowed = base64.b64encode(hashlib.sha256(SCRIPT.encode()).digest()).decode()
    return (
        "<!DOCTYPE html><meta charset='utf-8'>"
        f"""<meta http-equiv="Content-Security-Policy" content="default-src 'none'; script-src 'sha256-{allowed}'">"""
        f"<title>page {text}</title><body><h1>{text}</h1><script>{SCRIPT}</script></body>"
    )


@dataclass
class Sheet:
    """A file that is the page's text; one with ``wrong`` in it is refused."""

    path: Path
    made: int = 0

    def page(self) -> str:
        self.made += 1
        try:
            text = self.path.read_text("utf-8")
        except OSError as problem:
            raise SheetError(f"cannot read it: {problem.strerror}") from None
        if "wrong" in text:
            raise SheetError(
                [
                    Finding("error", "E_SHEET", f"no source named {HOSTILE}", "arm.yaml", 3),
                    Finding("error", "E_UNIT", "a length has the unit kg", "arm.yaml", 7),
                ]
            )
        return small_page(text)


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
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=5)
        try:
            connection.request(method, path, headers=headers)
            answer = connection.getresponse()
            return answer.status, dict(answer.getheaders()), answer.read()
        finally:
            connection.close()

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


def eventually(holds: Callable[[], bool], within: float = 5.0) -> bool:
    """Return whether something comes true in time."""
    end = time.monotonic() + within
    while not (true := holds()) and time.monotonic() < end:
        time.sleep(0.02)
    return true


def reachable(address: str, port: int) -> bool:
    try:
        socket.create_connection((address, port), timeout=1).close()
    except OSError:
        return False
    return True


# who can reach it


def test_it_listens_on_the_loopback_address_and_no_other(served):
    assert reachable("127.0.0.1", served.port)
    here = {
        one.address
        for addresses in psutil.net_if_addrs().values()
        for one in addresses
        if one.family in (socket.AF_INET, socket.AF_INET6)
    }
    others = (here | {"::1", "127.0.0.2"}) - {"127.0.0.1"}
    assert [address for address in others if reachable(address, served.port)] == []
    listening = [
        connection.laddr
        for connection in psutil.Process().net_connections("inet")
        if connection.status == psutil.CONN_LISTEN and connection.laddr.port == served.port
    ]
    assert [address.ip for address in listening] == ["127.0.0.1"]


@pytest.mark.skipif(sys.platform != "linux", reason="only Linux has all of 127.0.0.0/8 without being told")
def test_its_port_is_free_on_another_loopback_address(served):
    with socket.socket() as other:
        other.bind(("127.0.0.2", served.port))
        other.listen()
        # this is what an address that answers looks like to the test above
        assert reachable("127.0.0.2", served.port)


@pytest.mark.parametrize("path", ["/", "/page", "/version", "/page?0123", "/version?now"])
def test_the_three_paths_answer_with_headers_that_keep_others_out(steady, path):
    status, headers, body = steady.get(path)
    assert status == 200
    assert body
    assert int(headers["Content-Length"]) == len(body)
    assert headers["Content-Type"] == f"text/{'plain' if 'version' in path else 'html'}; charset=utf-8"
    assert headers["Cache-Control"] == "no-store"
    assert headers["X-Content-Type-Options"] == "nosniff"
    assert headers["Referrer-Policy"] == "no-referrer"
    assert headers["Cross-Origin-Resource-Policy"] == "same-origin"
    assert "Content-Security-Policy" in headers
    assert "Python" not in str(headers)
    head = steady.get(path, "HEAD")
    assert (head[0], head[2]) == (200, b"")
    assert head[1]["Content-Length"] == headers["Content-Length"]
    request = f"HEAD {path} HTTP/1.0\r\nHost: 127.0.0.1:{steady.port}\r\n\r\n"
    assert steady.raw(request.encode()).endswith(b"\r\n\r\n")


def test_the_page_is_the_text_that_was_made(served, sheet):
    assert served.get("/page")[2].decode("utf-8") == small_page("one")
    assert served.get("/page", Host=f"LOCALHOST:{served.port}")[0] == 200
    assert sheet.made == 1


def test_a_wrong_host_is_refused_in_plain_words(served):
    port = served.port
    wrong = [
        "evil.example", f"evil.example:{port}", "127.0.0.1", "localhost", f"127.0.0.1:{port + 1}", f"127.0.0.2:{port}",
        f"[::1]:{port}", f"127.0.0.1.evil.example:{port}", f"127.0.0.1:{port}, evil.example", f"user@127.0.0.1:{port}",
        f"0.0.0.0:{port}", "",
    ]  # fmt: skip
    for host in wrong:
        for path in ("/", "/page", "/version", "/nothing"):
            status, headers, body = served.get(path, Host=host)
            assert (status, body.decode()) == (403, f"403 open {served.address}\n")
            assert headers["Cross-Origin-Resource-Policy"] == "same-origin"
            assert headers["Content-Type"] == "text/plain; charset=utf-8"
    assert served.raw(b"GET /page HTTP/1.0\r\n\r\n").startswith(b"HTTP/1.0 403 ")
    twice = f"GET /page HTTP/1.1\r\nHost: 127.0.0.1:{port}\r\nHost: evil.example\r\n\r\n"
    assert served.raw(twice.encode()).startswith(b"HTTP/1.0 403 ")


@pytest.mark.parametrize(
    "path",
    ["/favicon.ico", "/page/", "/page/..", "/..", "/../../etc/passwd", "/%2e%2e/etc/passwd", "/arm.yaml", "//page/x",
     "/PAGE", "/p%61ge", "page", "http://127.0.0.1/page", "http://[/", "/<script>", "*"],
)  # fmt: skip
def test_every_other_path_is_not_found(steady, path):
    status, headers, body = steady.get(path, Host=f"127.0.0.1:{steady.port}")
    assert (status, body) == (404, b"404 Not Found\n")
    assert headers["X-Content-Type-Options"] == "nosniff"


@pytest.mark.parametrize("method", ["POST", "PUT", "DELETE", "OPTIONS", "PATCH", "TRACE", "CONNECT"])
def test_only_get_and_head_are_answered(steady, method):
    status, headers, body = steady.get("/page", method)
    assert status == 501
    assert b"<" not in body
    assert headers["Cache-Control"] == "no-store"


def test_broken_requests_and_readers_who_leave_are_nothing_to_it(served, capfd):
    served.raw(b"\0\xff\r\n\r\n")
    served.raw(b"GET / HTTP/9.9\r\n\r\n")
    served.raw(b"GET /" + b"a" * 70_000 + b" HTTP/1.0\r\n\r\n")
    served.raw(b"GET / HTTP/1.0\r\n" + b"x: y\r\n" * 200 + b"\r\n")
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


@pytest.mark.fast(1)
@pytest.mark.parametrize(
    "write",
    [replaced, lambda path, text: path.write_text(text, "utf-8"), rewritten_with_the_same_stamp],
)
def test_a_change_is_seen_however_it_is_written(served, sheet, write):
    first = served.get("/version")[2]
    write(sheet.path, "two")
    begun = time.monotonic()
    assert served.line() == "the files have changed; the page was rebuilt"
    assert time.monotonic() - begun < 3
    assert served.get("/page")[2].decode() == small_page("two")
    assert served.get("/version")[2] != first


@pytest.mark.slow
def test_a_touch_and_a_page_that_comes_out_the_same_change_nothing(served, sheet):
    version = served.get("/version")[2]
    os.utime(sheet.path, (1e9, 1e9))
    time.sleep(0.6)
    assert sheet.made == 1
    assert served.get("/version")[2] == version


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
def test_a_large_file_is_read_once(tmp_path, monkeypatch):
    opened = []
    genuine = Path.open

    def counted(self, *arguments, **more):
        opened.append(self)
        return genuine(self, *arguments, **more)

    mesh = tmp_path / "link.stl"
    mesh.write_bytes(b"solid")
    # ctime cannot be set back: the test's clock is ahead
    ahead = time.time_ns() + 10**10
    monkeypatch.setattr(time, "time_ns", lambda: ahead)
    monkeypatch.setattr(Path, "open", counted)
    with serving(lambda: "page", mesh):
        time.sleep(0.6)
        assert opened == [mesh]


@pytest.mark.slow
def test_a_file_in_the_middle_of_being_written_is_left_alone(served, sheet):
    # of a writer that the machine stopped for longer than the server waits, a half would rightly be read: try again
    for number in range(5):
        before, longest = sheet.made, 0.0
        for part in range(35):
            began = time.monotonic()
            sheet.path.write_text(f"half {number} {part}", "utf-8")
            time.sleep(0.02)
            longest = max(longest, time.monotonic() - began)
        if longest < 0.1:
            break
        time.sleep(1.0)
        for _ in range(sheet.made - before):
            served.line()
    assert sheet.made == before
    assert served.line().startswith("the files have changed")
    assert sheet.made == before + 1
    assert served.get("/page")[2].decode() == small_page(f"half {number} 34")


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


@pytest.mark.slow
def test_a_removed_file_is_an_error_until_it_is_back(served, sheet):
    sheet.path.unlink()
    assert served.line() == "precision-pin: error E_SHEET: cannot read it: No such file or directory"
    assert b"No such file or directory" in served.get("/page")[2]
    sheet.path.write_text("back", "utf-8")
    assert served.line().startswith("the files have changed")
    assert served.get("/page")[2].decode() == small_page("back")


def test_what_is_wrong_is_announced_and_shown_as_text(served, sheet):
    sheet.path.write_text("wrong", "utf-8")
    lines = served.line().splitlines()
    assert [line.split(": ")[:2] for line in lines] == [
        ["arm.yaml:3", "error E_SHEET"],
        ["arm.yaml:7", "error E_UNIT"],
    ]
    status, _, body = served.get("/page")
    text = body.decode("utf-8")
    assert status == 200
    assert "<script" not in text
    assert "<img" not in text
    assert "\u202e" not in text
    assert "arm.yaml:3: error E_SHEET: no source named &lt;/title&gt;&lt;script&gt;" in text
    assert "arm.yaml:7: error E_UNIT: a length has the unit kg" in text


def test_the_first_page_must_come_out_right(sheet):
    sheet.path.write_text("wrong", "utf-8")
    announced = []
    with pytest.raises(SheetError, match="a length has the unit kg"):
        serve(sheet.page, [sheet.path], open_browser=False, announce=announced.append)
    assert announced == []


@pytest.mark.slow
def test_a_bug_ends_the_server_and_frees_the_port(tmp_path):
    path = tmp_path / "arm.yaml"
    path.write_text("one", "utf-8")
    announced = []

    def make_page() -> str:
        if announced:
            raise ZeroDivisionError
        return "page"

    def tick() -> None:
        path.write_text("two", "utf-8")

    with pytest.raises(ZeroDivisionError):
        serve(make_page, [path], open_browser=False, announce=announced.append, tick=tick)
    assert not reachable("127.0.0.1", int(announced[0].rstrip("/").rpartition(":")[2]))


# in the browser


@pytest.fixture(scope="module")
def browser() -> Iterator[BrowserContext]:
    with chromium() as context:
        yield context


def await_text(page: Page, selector: str, text: str) -> None:
    """Wait until the first such element in the frame has the text; the frame may be loaded anew meanwhile."""
    page.wait_for_function(
        """([selector, text]) =>
          document.getElementById("page").contentDocument?.querySelector(selector)?.textContent === text""",
        arg=[selector, text],
        polling=50,
        timeout=10_000,
    )


def framed_state(page: Page) -> dict[str, str]:
    return page.evaluate("({ ...document.getElementById('page').contentDocument.body.dataset })")


@pytest.mark.slow
@needs_chromium
def test_the_browser_follows_the_file_through_an_error_and_keeps_the_slider(browser, served, sheet):
    visit = visited(browser, served.address + "#factor=50&look=tip&pose=3")
    page = visit.page
    body = page.frame_locator("#page").locator("body")
    await_text(page, "h1", "one")
    assert page.title() == "page one"
    assert framed_state(page) == {"factor": "50", "look": "tip", "pose": "3"}

    body.evaluate("(body) => { Object.assign(body.dataset, { factor: 123.5, pose: 4 }); window.mark = 'kept'; }")
    time.sleep(0.7)
    assert body.evaluate("() => window.mark") == "kept"  # nothing changed, nothing is loaded again

    sheet.path.write_text("two", "utf-8")
    await_text(page, "h1", "two")
    assert framed_state(page) == {"factor": "123.5", "look": "tip", "pose": "4"}

    sheet.path.write_text("wrong", "utf-8")
    await_text(page, "h1", "The page cannot be made")
    assert page.title() == "The page cannot be made"
    shown = body.locator("li").all_inner_texts()
    assert [line.split(": ")[0] for line in shown] == ["arm.yaml:3", "arm.yaml:7"]
    assert "<img src=x onerror=alert(1)>" in shown[0]
    assert body.locator("img, script").count() == 0

    replaced(sheet.path, "three")
    await_text(page, "h1", "three")
    assert page.title() == "page three"
    assert framed_state(page) == {"factor": "123.5", "look": "tip", "pose": "4"}
    assert page.evaluate("history.length") <= 2  # the reader's way back is not filled with versions
    assert complaints(visit) == []
    assert all(url.startswith(served.address) for url in outside_requests(visit))

    assert page.locator("#ended").is_hidden()
    served.stop.set()
    page.locator("#ended").wait_for(state="visible", timeout=5_000)
    assert "The server has ended" in page.locator("#ended").inner_text()
    await_text(page, "h1", "three")


@needs_chromium
@pytest.mark.slow
def test_the_real_page_works_in_the_frame_under_its_own_policy(browser, tmp_path):
    path = tmp_path / "arm.urdf"
    path.write_text(arm_text(), "utf-8")
    model = ErrorModel(Chain.from_urdf(path, tip="tool"), Space(), [])
    shown = [ViewPose(model.at(q), made_up_errors(50)) for q in ((0.4, -0.7), (0.0, 0.0))]

    def make_page() -> str:
        name = re.search(r'robot name="(.*?)"', path.read_text("utf-8"))
        assert name
        return page(shown, title=name[1], seed=1, model_name="exact", factor=20.0)

    with serving(make_page, path) as running:
        visit = visited(browser, running.address)
        await_text(visit.page, "h1", "two links")
        visit.page.frame_locator("#page").locator("body[data-ready]").evaluate(
            """() => {
              for (const [id, value] of [["pose", 1], ["factor", Math.log10(150)]]) {
                const slider = document.getElementById(id);
                slider.value = value;
                slider.dispatchEvent(new Event("input"));
              }
              document.getElementById("look-tip").click();
            }"""
        )
        path.write_text(arm_text(name="another arm"), "utf-8")
        await_text(visit.page, "h1", "another arm")
        visit.page.frame_locator("#page").locator("body[data-ready]").wait_for()
        state = framed_state(visit.page)
        assert float(state["factor"]) == pytest.approx(150, rel=1e-6)
        assert (state["look"], state["pose"]) == ("tip", "2")
        assert complaints(visit) == []


@pytest.mark.slow
@needs_chromium
def test_another_site_can_neither_frame_nor_read_it(browser, served):
    class Blank(http.server.BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            self.send_response(200)
            self.send_header("Content-Type", "text/html")
            self.end_headers()

        def log_message(self, format: str, *args: object) -> None:
            pass

    other = http.server.ThreadingHTTPServer(("127.0.0.1", 0), Blank)
    thread = threading.Thread(target=other.serve_forever, kwargs={"poll_interval": 0.05})
    thread.start()
    try:
        visit = visited(browser, f"http://127.0.0.1:{other.server_port}/")
        readable = "async (url) => { try { return await (await fetch(url)).text(); } catch { return 'refused'; } }"
        for path in ("", "page", "version"):
            assert visit.page.evaluate(readable, served.address + path) == "refused"
            visit.page.evaluate(
                """(url) => new Promise((loaded) => {
                  const frame = document.createElement('iframe');
                  frame.src = url;
                  frame.onload = loaded;
                  document.body.append(frame);
                })""",
                served.address + path,
            )
        refused = [line for line in visit.console if "frame-ancestors" in line]
        assert len(refused) >= 3
        assert not [frame for frame in visit.page.frames if frame.url.startswith(served.address)]
    finally:
        other.shutdown()
        thread.join()
        other.server_close()


# how it begins and ends


@dataclass
class FakeBrowser:
    name: str = "firefox"
    opened: queue.Queue[str] = field(default_factory=queue.Queue)
    until: threading.Event | None = None

    def open(self, address: str) -> bool:
        self.opened.put(address)
        if self.until is not None:
            self.until.wait(20)
        return True


def test_the_browser_is_opened_and_may_take_its_time(monkeypatch, sheet):
    browser = FakeBrowser(until=threading.Event())
    monkeypatch.setattr(webbrowser, "get", lambda: browser)
    with serving(sheet.page, open_browser=True) as running:
        assert browser.opened.get(timeout=5) == running.address
        assert running.get("/page")[0] == 200
        browser.until.set()


@pytest.mark.parametrize("problem", [webbrowser.Error("could not locate runnable browser"), OSError(2, "No such file")])
def test_no_browser_is_no_error(monkeypatch, sheet, problem):
    asked = threading.Event()

    def get() -> None:
        asked.set()
        raise problem

    monkeypatch.setattr(webbrowser, "get", get)
    with serving(sheet.page, open_browser=True) as running:
        assert asked.wait(5)
        assert running.get("/page")[0] == 200


def test_a_browser_for_the_terminal_is_not_opened(monkeypatch, sheet):
    browser = FakeBrowser(name="/usr/bin/w3m")
    monkeypatch.setattr(webbrowser, "get", lambda: browser)
    with serving(sheet.page, open_browser=True) as running:
        assert running.get("/page")[0] == 200
    assert browser.opened.empty()


def test_no_browser_is_opened_where_none_is_wanted(monkeypatch, sheet):
    browser = FakeBrowser()
    monkeypatch.setattr(webbrowser, "get", lambda: browser)
    with serving(sheet.page):
        time.sleep(0.2)
    assert browser.opened.empty()


def test_a_port_in_use_is_one_line_that_says_what_is_allowed(served, sheet):
    made = sheet.made
    with pytest.raises(OutputError) as caught:
        serve(sheet.page, port=served.port, open_browser=False, announce=pytest.fail)
    assert str(caught.value) == (
        f"precision-pin: error E_OUTPUT: cannot serve on port {served.port}: Address already in use; "
        "give 0 for any free port, or one of 1024 to 65535"
    )
    assert sheet.made == made


@pytest.mark.parametrize("port", [-1, 1, 80, 1023, 65536, 10**30, True, 8000.0, "8000", None])
def test_a_port_that_does_not_exist_or_is_reserved_is_refused(port):
    with pytest.raises(InputError, match=r"or one of 1024 to 65535$") as caught:
        serve(pytest.fail, port=port, announce=pytest.fail)
    assert "\n" not in str(caught.value)


PROGRAM = """
import sys
from pathlib import Path
from precision_pin.pages.view.live import serve

def make_page():
    Path(sys.argv[1]).read_text()
    {making}
    return "page"

serve(make_page, [Path(sys.argv[1])], open_browser=False,
      announce=lambda line: print(line, file=sys.stderr, flush=True))
print("after", flush=True)
"""


def started(sheet: Sheet, making: str = "") -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-c", PROGRAM.format(making=making), str(sheet.path)],
        stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True,
    )  # fmt: skip


def port_of(process: subprocess.Popen[str]) -> int:
    assert process.stderr is not None
    return int(process.stderr.readline().strip().rstrip("/").rpartition(":")[2])


@pytest.mark.slow
def test_ctrl_c_ends_it_at_once_and_the_port_can_be_used_again(sheet):
    process = started(sheet)
    try:
        port = port_of(process)
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
        assert not psutil.pid_exists(process.pid)
        assert not reachable("127.0.0.1", port)
        with serving(sheet.page, port=port) as again:
            assert again.port == port
    finally:
        process.kill()
        process.communicate()


@pytest.mark.slow
def test_ctrl_c_while_the_page_is_made_anew_ends_it_too(sheet, tmp_path):
    mark = tmp_path / "making"
    slow = f"""
    if "two" in Path(sys.argv[1]).read_text():
        import time
        Path({str(mark)!r}).touch()
        time.sleep(20)
    """
    process = started(sheet, making=slow)
    try:
        port = port_of(process)
        sheet.path.write_text("two", "utf-8")
        assert eventually(mark.exists)
        process.send_signal(signal.SIGINT)
        assert process.communicate(timeout=10) == ("after\n", "")
        assert process.returncode == 0
        assert not reachable("127.0.0.1", port)
    finally:
        process.kill()
        process.communicate()
