"""What is written appears whole or not at all; links, pipes, modes and owners stay what they are."""

from __future__ import annotations

import os
import stat
import subprocess
import sys
import threading
from pathlib import Path

import pytest

from runtime import OutputError, Plan
from runtime.documents.writing import check_writable, write_whole

PLAIN_USER = pytest.mark.skipif(os.geteuid() == 0, reason="root may write anywhere")


def test_a_link_stays_a_link_and_the_file_it_leads_to_is_replaced(tmp_path: Path) -> None:
    (tmp_path / "runs").mkdir()
    target = tmp_path / "runs" / "plan.json"
    target.write_bytes(b"before")
    (tmp_path / "latest.json").symlink_to("runs/plan.json")
    (tmp_path / "link.json").symlink_to(tmp_path / "latest.json")
    write_whole(tmp_path / "link.json", b"after")
    assert target.read_bytes() == b"after"
    assert (tmp_path / "link.json").is_symlink()
    assert (tmp_path / "latest.json").is_symlink()
    assert not target.is_symlink()
    assert [each.name for each in (tmp_path / "runs").iterdir()] == ["plan.json"]


def test_a_link_to_nothing_makes_the_file_it_names(tmp_path: Path) -> None:
    (tmp_path / "link").symlink_to("new")
    write_whole(tmp_path / "link", b"new")
    assert (tmp_path / "new").read_bytes() == b"new"
    assert (tmp_path / "link").is_symlink()


def test_links_in_a_circle_are_refused(tmp_path: Path) -> None:
    (tmp_path / "a").symlink_to("b")
    (tmp_path / "b").symlink_to("a")
    with pytest.raises(OutputError, match="a: cannot be written: Too many levels"):
        write_whole(tmp_path / "a", b"new")


@pytest.mark.parametrize("mode", [0o600, 0o640, 0o664, 0o755])
def test_the_mode_of_an_older_file_is_kept(mode: int, tmp_path: Path) -> None:
    path = tmp_path / "plan.json"
    path.write_bytes(b"before")
    path.chmod(mode)
    write_whole(path, b"after")
    assert stat.S_IMODE(path.stat().st_mode) == mode


@pytest.mark.parametrize("umask", [0o022, 0o077, 0o002])
def test_a_new_file_has_the_mode_of_the_umask(umask: int, tmp_path: Path) -> None:
    before = os.umask(umask)
    try:
        write_whole(tmp_path / "plan.json", b"new")
    finally:
        os.umask(before)
    assert stat.S_IMODE((tmp_path / "plan.json").stat().st_mode) == 0o666 & ~umask


@pytest.mark.skipif(os.geteuid() != 0, reason="only root may give a file away")
def test_the_owner_of_an_older_file_is_kept(tmp_path: Path) -> None:
    path = tmp_path / "plan.json"
    path.write_bytes(b"before")
    os.chown(path, 1234, 4321)
    write_whole(path, b"after")
    assert (path.stat().st_uid, path.stat().st_gid) == (1234, 4321)


def test_a_fifo_is_written_into_and_stays_a_fifo(plan: Plan, tmp_path: Path) -> None:
    fifo = tmp_path / "plan.json"
    os.mkfifo(fifo)
    read: list[bytes] = []
    reader = threading.Thread(target=lambda: read.append(fifo.read_bytes()))
    reader.start()
    plan.save(fifo)
    reader.join(30.0)
    assert fifo.is_fifo()
    assert b"".join(read).startswith(b'{"format": "slide-plan/')


def test_a_name_as_long_as_the_system_allows_is_written(tmp_path: Path) -> None:
    path = tmp_path / ("x" * 250 + ".json")
    write_whole(path, b"new")
    assert path.read_bytes() == b"new"


@pytest.mark.parametrize("descriptor", ["/dev/stdout", "/dev/fd/1", "/proc/self/fd/1"])
def test_standard_output_gets_what_was_printed_before_first(descriptor: str, tmp_path: Path) -> None:
    program = f"""
from pathlib import Path
from runtime.documents.writing import write_whole
print("first")
write_whole(Path({descriptor!r}), b"second\\n")
print("third")
"""
    with (tmp_path / "file").open("wb") as file:
        subprocess.run([sys.executable, "-c", program], stdout=file, check=True, timeout=60)
    assert (tmp_path / "file").read_bytes() == b"first\nsecond\nthird\n"


def test_a_closed_descriptor_is_refused() -> None:
    with pytest.raises(OutputError, match="/dev/fd/999: cannot be written: Bad file descriptor"):
        write_whole(Path("/dev/fd/999"), b"new")


def test_a_full_disk_leaves_what_was_there_before(plan: Plan, tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="/dev/full: cannot be written: No space left on device"):
        write_whole(Path("/dev/full"), b"new")
    program = """
import resource, signal, sys
from pathlib import Path
from runtime import OutputError
from runtime.documents.writing import write_whole
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
resource.setrlimit(resource.RLIMIT_FSIZE, (1000, 1000))  # the closest thing to a full disk that anybody may make
try:
    write_whole(Path(sys.argv[1]), bytes(5000))
except OutputError as error:
    print(error)
"""
    path = tmp_path / "plan.json"
    path.write_bytes(b"before")
    done = subprocess.run([sys.executable, "-c", program, path], capture_output=True, text=True, check=True, timeout=60)
    assert done.stdout == f"{path}: cannot be written: File too large\n"
    assert path.read_bytes() == b"before"
    assert [each.name for each in tmp_path.iterdir()] == ["plan.json"]


def test_a_path_with_a_nul_character_is_refused(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match="cannot be written: embedded null byte"):
        write_whole(tmp_path / "nul\0", b"new")


def test_a_folder_that_vanishes_is_one_error(tmp_path: Path) -> None:
    path = tmp_path / "folder" / "plan.json"
    path.parent.mkdir()
    check_writable(path)
    path.parent.rmdir()
    with pytest.raises(OutputError, match=r"plan.json: cannot be written: there is no folder .*folder"):
        write_whole(path, b"new")


@pytest.mark.parametrize(
    ("path", "reason"),
    [
        ("folder", "is a directory"),
        ("absent/plan.json", "there is no folder"),
        ("file/plan.json", "there is no folder"),
        ("y" * 300, "File name too long"),
    ],
)
def test_what_cannot_be_written_is_refused_before_the_work(path: str, reason: str, tmp_path: Path) -> None:
    (tmp_path / "folder").mkdir()
    (tmp_path / "file").touch()
    for attempt in (check_writable, lambda path: write_whole(path, b"new")):
        with pytest.raises(OutputError, match=f"cannot be written: .*{reason}"):
            attempt(tmp_path / path)
    assert sorted(each.name for each in tmp_path.iterdir()) == ["file", "folder"]


@PLAIN_USER
@pytest.mark.parametrize("protected", ["folder", "file"])
def test_what_is_protected_stays_as_it_is(protected: str, tmp_path: Path) -> None:
    path = tmp_path / "plan.json"
    path.write_bytes(b"before")
    place = tmp_path if protected == "folder" else path
    mode = place.stat().st_mode
    place.chmod(mode & ~0o222)
    try:
        for attempt in (check_writable, lambda path: write_whole(path, b"new")):
            with pytest.raises(OutputError, match=r"plan.json: cannot be written: .*(no permission|protected)"):
                attempt(path)
    finally:
        place.chmod(mode)
    assert path.read_bytes() == b"before"
