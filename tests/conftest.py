"""What all tests need of the process they run in."""

import gc
import os
import signal
import sys

import pytest

from support import site

# matrices here are small: with as many threads as cores in each of as many workers they would wait for each other
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

# pytest compiles the tests with their asserts taken apart: five seconds for each process, unless it is kept
sys.dont_write_bytecode = False

# what importing and collecting makes stays: to look through it again and again for garbage takes seconds
gc.disable()

# a shell that starts the tests in the background has Ctrl-C ignored, and so would every command that tests start
signal.signal(signal.SIGINT, signal.default_int_handler)


def pytest_xdist_auto_num_workers(config):
    """Take no workers where only files are named: each imports everything anew."""
    return 0 if all(".py" in word for word in config.args) else None


@pytest.hookimpl(tryfirst=True)
def pytest_sessionstart(session):
    """Compile the sampler before there are workers: each of them would compile all of it, at the same time."""
    if getattr(session.config.option, "tx", None) and not hasattr(session.config, "workerinput"):
        _compile_all_variants()


@pytest.hookimpl(tryfirst=True)
def pytest_collection_modifyitems(items):
    """Of the cases of a test marked ``fast(n)``, n spread evenly run in the fast run; tests with a browser come last.

    At first a worker's other tests and the build of the site leave a browser no processor to draw with.
    """
    items.sort(key=opens_browser)
    cases = {}
    for item in items:
        if item.get_closest_marker("fast") and not item.get_closest_marker("slow"):
            cases.setdefault((item.path, item.nodeid.partition("[")[0]), []).append(item)
    for listed in cases.values():
        (count,) = listed[0].get_closest_marker("fast").args  # type: ignore[union-attr]
        kept = {k * len(listed) // count for k in range(count)}
        for k, item in enumerate(listed):
            if k not in kept:
                item.add_marker("slow")


def _compile_all_variants():
    from precision_pin.base.compile_ahead import Job, compile_jobs
    from precision_pin.kernel import parts, sampler

    # the linear model holds its datum
    kinds = ((None, None), (None, True), (True, None))
    variants = [(rare, linear, datum) for rare in (None, True) for linear, datum in kinds]
    if os.environ.get("NUMBA_DISABLE_JIT") or all(sampler.is_compiled(*variant) for variant in variants):
        return
    ahead = dict.fromkeys(job for variant in variants for job in parts.part_jobs(*variant[:2]))
    functions = ("warm_up", "warm_up_poses")
    whole = [
        Job("precision_pin.kernel.sampler", function, variant, 3.5, last=True)
        for function in functions
        for variant in variants
    ]
    compile_jobs([*ahead, *whole])


def pytest_collection_finish():
    """Run the garbage collector less often: what importing and collecting made stays.

    Not `gc.freeze`: Hypothesis looks for the referrers of its generator, and finds none among frozen objects.
    """
    gc.set_threshold(50_000, 20, 20)
    gc.enable()


def pytest_sessionfinish():
    """Collect garbage once: pytest does so five times at the end, to find errors that nobody saw."""
    gc.collect()
    gc.freeze()


@pytest.fixture(scope="session", autouse=True)
def site_begun(request, tmp_path_factory):
    """Build the site beside the other tests: in their turn, the workers would wait a minute for one of them."""
    is_needed = any(item.path.name == "test_site.py" for item in request.session.items)
    process = site.begin(tmp_path_factory.getbasetemp()) if is_needed else None
    yield
    if process is not None:
        process.wait()


@pytest.hookimpl(wrapper=True)
def pytest_runtest_teardown(item, nextitem):
    """End the browser after the last of the tests that share one."""
    yield
    if "support.browser" in sys.modules and (nextitem is None or not opens_browser(nextitem)):
        sys.modules["support.browser"].close_browser()


def opens_browser(item):
    browser = sys.modules.get("support.browser")
    return browser is not None and browser.needs_chromium.mark in item.iter_markers("skipif")


HANDLERS = {number: signal.getsignal(number) for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)}


@pytest.fixture(autouse=True)
def signals_stay():
    """Give the tests their signals back: the command line keeps them to the end, in a module's fixture too."""
    take_signals_back()
    yield
    take_signals_back()


def take_signals_back():
    for number, handler in HANDLERS.items():
        signal.signal(number, handler)
