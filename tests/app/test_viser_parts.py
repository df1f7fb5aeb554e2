"""What we use of viser beside its public interface is there, and one line says so where it is not."""

import asyncio
import sys
import threading
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from types import SimpleNamespace

import pytest
import viser

from app import viser_parts
from app.viser_parts import (
    PARTS,
    CrossThreadEvent,
    allow_threads,
    check_parts,
    limit_messages,
    read_page,
    websocket_server,
)
from core.errors import PackageError


def test_all_parts_are_there() -> None:
    check_parts()
    head, rest = read_page()
    assert head.startswith("<!") and "</html>" in rest


@pytest.mark.parametrize(("module", "attribute"), PARTS)
def test_a_part_that_has_moved_is_named_with_the_version_to_install(module: str, attribute: str, monkeypatch) -> None:
    __import__(module)
    owner = sys.modules[module]
    *path, name = attribute.split(".")
    for part in path:
        owner = getattr(owner, part)
    monkeypatch.delattr(owner, name)
    with pytest.raises(PackageError) as error:
        check_parts()
    assert f"lacks {module}.{attribute}" in str(error.value)
    assert "pip install 'viser==" in str(error.value) and "\n" not in str(error.value)


def test_a_page_without_its_title_is_named(tmp_path: Path, monkeypatch) -> None:
    (tmp_path / "client" / "build").mkdir(parents=True)
    (tmp_path / "client" / "build" / "index.html").write_text("<html><title>Another</title></html>")
    monkeypatch.setattr(viser, "__file__", str(tmp_path / "__init__.py"))
    with pytest.raises(PackageError, match=r"index\.html"):
        check_parts()


def test_a_server_without_its_websocket_server_is_named() -> None:
    with pytest.raises(PackageError, match="_websock_server"):
        websocket_server(object())  # type: ignore[arg-type]


@pytest.mark.parametrize("name", ["max_message_size", "max_size"])
def test_messages_are_limited_by_the_name_that_this_websockets_has(name: str) -> None:
    protocol = SimpleNamespace(**{name: 2**30})
    limit_messages(SimpleNamespace(protocol=protocol), 5)
    assert vars(protocol) == {name: 5}


def test_a_limit_that_is_nowhere_is_named() -> None:
    with pytest.raises(PackageError, match="max_message_size"):
        limit_messages(SimpleNamespace(protocol=object()), 5)


def test_the_version_that_is_named_is_the_pinned_one() -> None:
    constraints = (Path(__file__).parents[2] / "constraints.txt").read_text(encoding="utf-8").split()
    assert f"viser=={viser_parts.TESTED}" in constraints


def test_an_event_that_another_thread_sets_wakes_nobody_there() -> None:
    """A plain one goes through its waiters in that thread, and raises an error where one comes or goes meanwhile."""

    async def wait_and_look() -> None:
        event = CrossThreadEvent()
        waiter = asyncio.ensure_future(event.wait())
        await asyncio.sleep(0)
        (future,) = event._waiters  # type: ignore[attr-defined]
        other = threading.Thread(target=event.set)
        other.start()
        other.join()
        assert event.is_set() and not future.done()
        event.set()  # as viser does in the event loop after that
        assert await waiter

    with ThreadPoolExecutor(1) as thread:  # whose event loop is its own: another test may have left one here
        thread.submit(asyncio.run, wait_and_look()).result()


def test_a_connection_without_its_buffer_is_named() -> None:
    with pytest.raises(PackageError, match="message_event"):
        allow_threads(object())
