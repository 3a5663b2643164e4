import errno
import os
import stat
import subprocess
import sys

import numpy as np
import pytest

from ilattice import _files as _common
from ilattice._files import atomic_path, atomic_write, read_text
from ilattice.errors import FormatError, InputError
from ilattice.io._scanner import Scanner, parse_numbers


def test_a_file_is_written_whole(tmp_path):
    with atomic_write(tmp_path / "a.bin") as file:
        file.write(b"abc")
        assert not (tmp_path / "a.bin").exists()
    assert (tmp_path / "a.bin").read_bytes() == b"abc"
    assert os.listdir(tmp_path) == ["a.bin"]


def test_text_has_unix_line_ends(tmp_path):
    with atomic_write(tmp_path / "a.txt", text=True) as file:
        file.write("ä\n")
    assert (tmp_path / "a.txt").read_bytes() == "ä\n".encode()


@pytest.mark.parametrize("trouble", [KeyboardInterrupt, MemoryError, SystemExit, ValueError])
def test_an_interrupted_save_leaves_the_old_file(tmp_path, trouble):
    path = tmp_path / "a.txt"
    path.write_text("old")

    def save():
        with atomic_write(path, text=True) as file:
            file.write("new" * 10000)
            raise trouble

    with pytest.raises(trouble):
        save()
    assert path.read_text() == "old"
    assert os.listdir(tmp_path) == ["a.txt"]


def test_a_full_disk_leaves_the_old_file(tmp_path, monkeypatch):
    path = tmp_path / "a.txt"
    path.write_text("old")

    def full(_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(_common.os, "fsync", full)
    with pytest.raises(FormatError, match="disk is full"), atomic_write(path) as file:
        file.write(b"new")
    assert path.read_text() == "old"
    assert os.listdir(tmp_path) == ["a.txt"]


@pytest.mark.skipif(sys.platform == "win32", reason="needs limits of the file size")
def test_a_real_write_error_leaves_the_old_file(tmp_path):
    import resource

    path = tmp_path / "a.txt"
    path.write_text("old")
    old = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (1000, old[1]))
    try:
        with (
            pytest.raises(FormatError, match=r"larger than files may be here.*ulimit -f") as caught,
            atomic_write(path) as file,
        ):
            file.write(b"x" * 100_000)
        assert "disk is full" not in str(caught.value)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, old)
    assert path.read_text() == "old"
    assert os.listdir(tmp_path) == ["a.txt"]


@pytest.mark.skipif(not os.path.exists("/dev/full"), reason="needs /dev/full")
def test_a_device_is_written_directly_and_stays_a_device():
    with pytest.raises(FormatError, match="disk is full"), atomic_write("/dev/full") as file:
        file.write(b"x" * 100_000)
    assert stat.S_ISCHR(os.stat("/dev/full").st_mode)


def test_places_that_cannot_be_files_are_refused_before_writing(tmp_path):
    for path in (tmp_path, tmp_path / "no" / "a.txt", "", "a\0b"):
        with pytest.raises(InputError, match="path"), atomic_write(path):
            raise AssertionError("the block must not run")
    with pytest.raises(InputError, match="path"), atomic_write(5):
        raise AssertionError("the block must not run")


@pytest.mark.skipif(getattr(os, "geteuid", lambda: 0)() == 0, reason="root may write everywhere")
def test_a_directory_without_permission(tmp_path):
    tmp_path.chmod(0o500)
    with pytest.raises(FormatError, match="cannot be written"), atomic_write(tmp_path / "a"):
        raise AssertionError("the block must not run")


def test_permissions_of_the_old_file_are_kept(tmp_path):
    path = tmp_path / "a.txt"
    path.write_text("old")
    path.chmod(0o640)
    with atomic_write(path) as file:
        file.write(b"new")
    assert stat.S_IMODE(path.stat().st_mode) == 0o640
    assert path.read_text() == "new"


def test_new_files_obey_the_mask_of_the_process(tmp_path):
    old = os.umask(0o027)
    try:
        with atomic_write(tmp_path / "a"):
            pass
    finally:
        os.umask(old)
    assert stat.S_IMODE((tmp_path / "a").stat().st_mode) == 0o640


def test_symbolic_links_are_followed(tmp_path):
    (tmp_path / "real").mkdir()
    (tmp_path / "real" / "a").write_text("old")
    (tmp_path / "link").symlink_to(tmp_path / "real" / "a")
    with atomic_write(tmp_path / "link") as file:
        file.write(b"new")
    assert (tmp_path / "link").is_symlink()
    assert (tmp_path / "real" / "a").read_text() == "new"


def test_the_temporary_name_keeps_the_ending(tmp_path):
    with atomic_path(tmp_path / "mesh.vtu") as temporary:
        assert temporary.suffix == ".vtu"
        assert temporary.parent == tmp_path
        temporary.write_text("x")
    assert (tmp_path / "mesh.vtu").read_text() == "x"


def test_what_cannot_be_read_is_a_format_error(tmp_path):
    (tmp_path / "binary").write_bytes(b"a\nb\0")
    with pytest.raises(FormatError, match="line 2: zero byte"):
        read_text(tmp_path / "binary")
    with pytest.raises(FormatError, match="cannot be read"):
        read_text(tmp_path / "nothing")
    with pytest.raises(FormatError, match="not a regular file"):
        read_text(tmp_path)


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "utf-16", "latin-1"])
def test_text_encodings(tmp_path, encoding):
    (tmp_path / "a").write_bytes("größe 1".encode(encoding))
    assert read_text(tmp_path / "a") == "größe 1"


def test_scanner_tells_the_line():
    s = Scanner("one\n2 x\n\n 3.5 inf", "file")
    assert s.expect("one", "two") == "one"
    assert s.integer("a count", 1, 5) == 2
    with pytest.raises(FormatError, match="file, line 2: found 'x'; expected a number of things"):
        s.integer("a number of things")
    with pytest.raises(FormatError, match="line 4: found 'inf'"):
        s.numbers(2, "knots")
    with pytest.raises(FormatError, match="holds only 2 more"):
        s.numbers(10**12, "knots")
    assert s.numbers(1, "knots").tolist() == [3.5]
    s.word("anything")
    with pytest.raises(FormatError, match="line 4: the file ends; expected 'more'"):
        s.expect("more")


def test_scanner_refuses_rows_with_misplaced_brackets():
    s = Scanner("[1 2]\n[3 4 ]", "file", r"[\[\]]|[^\s\[\]]+")
    assert s.rows(2, 2, "points").tolist() == [[1, 2], [3, 4]]
    s = Scanner("[1 2]\n3 [4 ]", "file", r"[\[\]]|[^\s\[\]]+")
    with pytest.raises(FormatError, match=r"line 2: found '3' in points; expected '\['"):
        s.rows(2, 2, "points")
    s = Scanner("[1 2]\n[3 a]", "file", r"[\[\]]|[^\s\[\]]+")
    with pytest.raises(FormatError, match="line 2: found 'a'"):
        s.rows(2, 2, "points")


@pytest.mark.parametrize(
    ("tokens", "result"),
    [(["1", "-2e3"], [1, -2000]), (["1", "x"], 1), (["nan"], 0), (["1", "1e999"], 1), (["1_0"], 0)],
)
def test_numbers(tokens, result):
    found = parse_numbers(tokens)
    assert np.array_equal(found, result)
    assert isinstance(found, int) == isinstance(result, int)


@pytest.mark.skipif(not os.path.exists("/dev/stdout"), reason="needs /dev/stdout")
@pytest.mark.parametrize("stream", ["/dev/stdout", "/dev/fd/1", "/proc/self/fd/1"])
def test_what_a_stream_was_sent_to_is_continued(tmp_path, stream):
    """The file of ``>> log`` was replaced by the report, and what it held was lost."""
    program = (
        "from ilattice._files import atomic_write\n"
        "print('before')\n"
        f"with atomic_write({stream!r}, text=True) as file:\n    file.write('report\\n')\n"
        "print('after')\n"
    )
    log = tmp_path / "log.txt"
    log.write_text("kept\n")
    with log.open("a") as file:
        subprocess.run(
            [sys.executable, "-c", program], stdout=file, check=True, timeout=100,
            env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
        )  # fmt: skip
    assert log.read_text() == "kept\nbefore\nreport\nafter\n"
    assert os.listdir(tmp_path) == ["log.txt"]
