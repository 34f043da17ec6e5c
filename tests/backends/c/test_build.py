"""The cache of compiled C on disk: what is kept, what is rebuilt, and what happens where nothing can be kept."""

from __future__ import annotations

import ctypes
import os
import shutil
import stat
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from teg.backends.c import build as c_build
from teg.backends.c import cache as c_cache
from teg.errors import CompilerError, OptionError

pytestmark = pytest.mark.skipif(not any(map(shutil.which, ("cc", "gcc", "clang"))), reason="needs a C compiler")
ROOT = Path(__file__).resolve().parents[3]
POSIX = pytest.mark.skipif(sys.platform == "win32", reason="POSIX")
SCRIPT = """
import sys, teg.backends.c.build as c_build, teg.backends.c.cache as c_cache
for k in map(int, sys.argv[1].split(",")):
    assert c_build.load_library("int answer(void) { return %d; }" % k).answer() == k
print(c_cache.cache_folder())
"""


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty cache of the test's own, trimmed after every build."""
    folder = tmp_path / "cache"
    monkeypatch.setenv("TEG_CACHE_DIR", str(folder))
    monkeypatch.setattr(c_cache, "PAUSE", 0.0)
    return folder


def entries(cache: Path) -> list[Path]:
    return sorted(cache.glob("*/*" + c_cache.SUFFIX))


def answer(number: int) -> int:
    return c_build.load_library(f"int answer(void) {{ return {number}; }}").answer()


def run(answers: str = "42", before: list[str] | None = None, **environment: str | None) -> Path:
    """Load libraries in another process, perhaps by a command that prepares what it finds; the folder that was used."""
    changed = {**os.environ, **{k: v for k, v in environment.items() if v is not None}}
    for k in (k for k, v in environment.items() if v is None):
        changed.pop(k, None)
    command = [*(before or []), sys.executable, "-c", SCRIPT, answers]
    done = subprocess.run(command, capture_output=True, text=True, env=changed, cwd=ROOT, check=False)
    assert done.returncode == 0, done.stderr
    return Path(done.stdout.strip())


# What is kept


@POSIX
def test_an_entry_is_private_and_used_again(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    assert answer(1) == 1
    (entry,) = entries(cache)
    assert stat.S_IMODE(cache.stat().st_mode) == stat.S_IMODE(entry.parent.stat().st_mode) == 0o700
    assert [p.name for p in entry.parent.iterdir()] == [entry.name]  # no source, no workshop
    monkeypatch.setattr(c_build, "compile_library", lambda *_: pytest.fail("compiled again"))
    assert answer(1) == 1


def test_the_key_knows_text_compiler_version_flags_and_processor(monkeypatch: pytest.MonkeyPatch) -> None:
    def key(text: str = "t", compiler: str = "cc", flag: str = "-O3") -> str:
        return c_build._key(text, (compiler,), (flag,))

    monkeypatch.setattr(c_build, "_version", lambda _: "1")
    known = {key(), key("u"), key(flag="-O1"), key(compiler="gcc")}
    monkeypatch.setattr(c_build, "_version", lambda _: "2")
    known.add(key())
    monkeypatch.setattr(c_build, "_processor", lambda: "another machine")
    known.add(key())
    assert len(known) == 6
    assert key() == key()


def test_a_new_compiler_makes_a_stale_entry_unused(cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The same path, another version, as after an upgrade of the system."""
    real, compiler = c_build.find_compiler()[0], tmp_path / "cc"

    def install(version: str) -> None:
        compiler.write_text(f'#!/bin/sh\nif [ "$1" = --version ]; then echo {version}; exit; fi\nexec "{real}" "$@"\n')
        compiler.chmod(0o755)
        c_build._version.cache_clear()

    monkeypatch.setenv("CC", str(compiler))
    for version, count in (("one", 1), ("one", 1), ("two", 2)):
        install(version)
        assert answer(2) == 2
        assert len(entries(cache)) == count
    c_build._version.cache_clear()


# What is rebuilt


@pytest.mark.parametrize("damage", ["empty", "text", "half", "one byte"])
def test_a_damaged_entry_is_rebuilt(cache: Path, damage: str) -> None:
    """Half a library a loader may only notice by crashing: hence another process."""
    run()
    (entry,) = entries(cache)
    whole = entry.read_bytes()
    middle = len(whole) // 2
    changed = whole[:middle] + bytes([whole[middle] ^ 1]) + whole[middle + 1 :]
    entry.write_bytes({"empty": b"", "text": b"not a library", "half": whole[:middle], "one byte": changed}[damage])
    run()
    (entry,) = entries(cache)
    assert c_cache.digest_of(entry) == entry.stem


def test_an_entry_of_the_right_digest_that_cannot_be_loaded_is_rebuilt(cache: Path) -> None:
    run()
    (entry,) = entries(cache)
    entry.unlink()
    fake = entry.with_name("fake" + c_cache.SUFFIX)
    fake.write_bytes(b"not a library")
    fake.rename(entry.with_name(c_cache.digest_of(fake) + c_cache.SUFFIX))
    run()
    assert [path.name for path in entries(cache)] == [entry.name]


def test_a_cache_that_is_cleared_during_a_build_is_no_mistake(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    started = subprocess.run

    def cleared_first(*command: Any, **options: Any) -> Any:
        if cache in Path(options.get("cwd", "/")).parents:
            c_cache.clear(cache)
        return started(*command, **options)

    monkeypatch.setattr(subprocess, "run", cleared_first)
    assert answer(8) == 8
    assert not entries(cache)


def test_what_a_killed_build_left_is_removed_after_a_day(cache: Path) -> None:
    answer(3)
    (entry,) = entries(cache)
    entry.unlink()
    old, new = (entry.parent / f"build-{name}" for name in ("old", "new"))
    for folder in (old, new):
        folder.mkdir()
        (folder / "kernel.c").touch()
    os.utime(old, (time.time() - 2 * c_cache.ABANDONED,) * 2)
    answer(3)
    assert not old.exists()
    assert new.exists()


# Several processes


def test_processes_that_build_the_same_at_once_share_it(cache: Path) -> None:
    command = [sys.executable, "-c", SCRIPT, "0,1,2"]
    running = [subprocess.Popen(command, stdout=subprocess.DEVNULL, cwd=ROOT) for _ in range(4)]
    assert [process.wait() for process in running] == [0] * 4
    assert len(entries(cache)) == 3
    assert not list(cache.glob("*/build-*"))
    assert {c_cache.digest_of(entry) for entry in entries(cache)} == {entry.stem for entry in entries(cache)}


@POSIX
def test_two_builds_that_end_at_the_same_time_leave_one_whole_entry(cache: Path, tmp_path: Path) -> None:
    """A compiler that waits for the other one, so that both surely build."""
    real, meeting, compiler = c_build.find_compiler()[0], tmp_path / "meeting", tmp_path / "cc"
    meeting.mkdir()
    compiler.write_text(
        f'#!/bin/sh\ncase $1 in --version) echo 1; exit;; esac\n"{real}" "$@" || exit\n'
        f"touch {meeting}/$$\nfor i in $(seq 200); do [ $(ls {meeting} | wc -l) -ge 2 ] && exit; sleep 0.05; done; exit 1\n"
    )
    compiler.chmod(0o755)
    environment = {**os.environ, "CC": str(compiler)}
    command = [sys.executable, "-c", SCRIPT, "7"]
    running = [subprocess.Popen(command, env=environment, stdout=subprocess.DEVNULL, cwd=ROOT) for _ in range(2)]
    assert [process.wait() for process in running] == [0, 0]
    assert len(list(meeting.iterdir())) == 2
    assert len(entries(cache)) == 1
    assert c_cache.digest_of(entries(cache)[0]) == entries(cache)[0].stem


# What is removed


def aged(path: Path, hours: float) -> float:
    """Make an entry one that was used so long ago; its size in MB."""
    then = time.time() - 3600 * hours
    os.utime(path, (then, then))
    return path.stat().st_size / c_cache.MEGABYTE


def made(cache: Path, number: int) -> Path:
    """The entry of a new library."""
    before = set(entries(cache))
    assert answer(number) == number
    (new,) = set(entries(cache)) - before
    return new


def test_what_was_used_longest_ago_is_removed(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    first, second, third = (made(cache, number) for number in (1, 2, 3))
    sizes = [aged(path, hours) for path, hours in ((first, 5), (second, 4), (third, 3))]
    assert answer(1) == 1  # which makes it the one used last
    monkeypatch.setenv("TEG_CACHE_SIZE", str(sum(sizes) + 0.5 * sizes[0]))
    fourth = made(cache, 4)
    assert set(entries(cache)) == {first, third, fourth}
    assert not second.parent.exists()
    assert answer(2) == 2


def test_what_may_be_in_use_is_kept(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TEG_CACHE_SIZE", "0")
    first, second = made(cache, 1), made(cache, 2)
    assert entries(cache) == sorted([first, second])
    aged(first, 1)
    third = made(cache, 3)
    assert entries(cache) == sorted([second, third])


def test_entries_are_looked_at_once_a_minute(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(c_cache, "PAUSE", 60.0)
    monkeypatch.setenv("TEG_CACHE_SIZE", "0")
    first = made(cache, 1)
    aged(first, 1)
    second = made(cache, 2)
    assert entries(cache) == sorted([first, second])
    aged(cache / c_cache.TRIMMED, 1)
    third = made(cache, 3)
    assert entries(cache) == sorted([second, third])


def test_objects_count_and_other_files_are_left_alone(cache: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    c_build.load_linked("int f(void); int g(void) { return f(); }", ["int f(void) { return 7; }"], "int h;", optimise=("-O1",))
    assert {entry.path.suffix for entry in c_cache.entries_of(cache)} == {c_cache.SUFFIX, c_cache.OBJECT}
    for entry in c_cache.entries_of(cache):
        aged(entry.path, 1)
    (cache / "notes").mkdir()
    (cache / "notes" / "mine.o").touch()
    monkeypatch.setenv("TEG_CACHE_SIZE", "0")
    last = made(cache, 1)
    assert [entry.path for entry in c_cache.entries_of(cache)] == [last]
    assert [entry.path for entry in c_cache.clear(cache)] == [last]
    assert [path.name for path in cache.iterdir()] == ["notes"]
    assert (cache / "notes" / "mine.o").exists()


@pytest.mark.parametrize("size", ["many", "-1", "nan"])
def test_a_size_that_is_none_is_named(size: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TEG_CACHE_SIZE", size)
    with pytest.raises(OptionError, match="TEG_CACHE_SIZE"):
        c_cache.size_limit()


# Where nothing can be kept


def test_where_the_cache_is(tmp_path: Path) -> None:
    home = str(tmp_path / "home")
    assert run(TEG_CACHE_DIR=str(tmp_path / "own"), XDG_CACHE_HOME=str(tmp_path / "xdg"), HOME=home) == tmp_path / "own"
    assert run(TEG_CACHE_DIR=None, XDG_CACHE_HOME=str(tmp_path / "xdg"), HOME=home) == tmp_path / "xdg" / "teg"
    assert run(TEG_CACHE_DIR=None, XDG_CACHE_HOME="not/absolute", HOME=home) == tmp_path / "home" / ".cache" / "teg"
    assert run(TEG_CACHE_DIR=None, XDG_CACHE_HOME=None, HOME=home) == tmp_path / "home" / ".cache" / "teg"


@POSIX
@pytest.mark.parametrize("home", ["/dev/null", "/proc/nowhere", ""])
def test_a_home_that_is_none_is_replaced(home: str) -> None:
    folder = run(TEG_CACHE_DIR=None, XDG_CACHE_HOME=None, HOME=home)
    assert folder.name.startswith("teg-") or home == ""
    assert not folder.exists() or home == ""  # removed at exit


def test_a_cache_that_cannot_be_made_is_replaced(tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    folder = run(TEG_CACHE_DIR=str(tmp_path / "file" / "below"))
    assert not folder.exists()


@POSIX
@pytest.mark.parametrize("mode", [0o777, 0o722, 0o770])
def test_a_folder_that_others_can_write_is_not_used(cache: Path, mode: int) -> None:
    cache.mkdir()
    cache.chmod(mode)
    assert answer(4) == 4
    assert not list(cache.iterdir())
    assert stat.S_IMODE(c_cache.cache_folder().stat().st_mode) == 0o700


@POSIX
def test_a_read_only_home_of_a_plain_user(tmp_path: Path) -> None:
    """As a user for whom permissions count; root is made to be nobody."""
    home = Path("/tmp") / f"teg-test-{os.getpid()}"
    home.mkdir(mode=0o755)
    home.chmod(0o555)
    try:
        nobody = ["setpriv", "--reuid", "65534", "--regid", "65534", "--clear-groups"] if os.getuid() == 0 else []
        probe = [*nobody, sys.executable, "-c", "import numpy"]
        if nobody and (not shutil.which("setpriv") or subprocess.run(probe, check=False).returncode):
            pytest.skip("no other user can run this Python")
        folder = run(before=nobody, TEG_CACHE_DIR=None, XDG_CACHE_HOME=None, HOME=str(home), TMPDIR="/tmp")
        assert folder.name.startswith("teg-")
        assert not list(home.iterdir())
    finally:
        home.chmod(0o755)
        home.rmdir()


def mounted(folder: Path, options: str, then: str = "") -> list[str]:
    """The command before a command, that mounts a small memory disk there, for it alone."""
    folder.mkdir()
    return ["unshare", "-rm", "sh", "-c", f'mount -t tmpfs -o {options},mode=700 none "{folder}" && {then or ":"} && exec "$@"', "sh"]


@pytest.fixture
def can_mount(tmp_path: Path) -> None:
    probe = mounted(tmp_path / "probe", "size=64k")
    if not shutil.which("unshare") or subprocess.run([*probe, "true"], capture_output=True, check=False).returncode:
        pytest.skip("no disk can be mounted here")


@pytest.mark.parametrize("size", ["4k", "12k", "24k"])
@pytest.mark.usefixtures("can_mount")
def test_a_full_disk(tmp_path: Path, size: str) -> None:
    """Without room for the folders, for the compiler's files, or for the library: it is kept elsewhere, for this process."""
    disk = tmp_path / "disk"
    run("1,2", before=mounted(disk, f"size={size}"), TEG_CACHE_DIR=str(disk / "cache"))


@pytest.mark.usefixtures("can_mount")
def test_a_disk_that_is_read_only(tmp_path: Path) -> None:
    disk = tmp_path / "disk"
    before = mounted(disk, "size=1m", f'mkdir -m 700 "{disk}/cache" && mount -o remount,ro none "{disk}"')
    assert run(before=before, TEG_CACHE_DIR=str(disk / "cache")).name.startswith("teg-")


@pytest.mark.usefixtures("can_mount")
def test_a_disk_from_which_nothing_may_be_loaded(tmp_path: Path) -> None:
    disk = tmp_path / "disk"
    run("1,2", before=mounted(disk, "size=4m,noexec"), TEG_CACHE_DIR=str(disk / "cache"))


# The compiler


def test_the_compilers_message_is_in_the_error(cache: Path) -> None:
    with pytest.raises(CompilerError) as error:
        c_build.load_library("int f(void) { return nonsense; }")
    assert "nonsense" in error.value.hint
    assert not entries(cache)
    assert not list(cache.glob("*/build-*"))


@POSIX
def test_nothing_is_run_by_a_shell(cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Names of folders and of the compiler are arguments, whatever is in them."""
    odd = tmp_path / "a; touch $(echo broken) 'b"
    odd.mkdir()
    compiler = odd / 'cc"; rm -rf x'
    compiler.symlink_to(c_build.find_compiler()[0])
    monkeypatch.setenv("CC", f"""'{str(compiler).replace("'", "'" + '"' + "'" + '"' + "'")}'""")
    monkeypatch.setenv("TEG_CACHE_DIR", str(odd / "cache $HOME"))
    assert c_build.find_compiler() == (str(compiler),)
    assert answer(5) == 5
    assert len(entries(odd / "cache $HOME")) == 1


def test_temporary_files_of_the_compiler_go_into_its_own_folder(cache: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("TMPDIR", str(tmp_path / "nowhere"))
    assert answer(6) == 6


def test_a_library_is_one_that_ctypes_loads(cache: Path) -> None:
    library = c_build.load_library("double twice(double x) { return 2.0 * x; }")
    library.twice.restype, library.twice.argtypes = ctypes.c_double, [ctypes.c_double]
    assert library.twice(1.5) == 3.0


@pytest.mark.parametrize("command", ["gcc '", 'cc "-O2', "cc \\"])
def test_a_command_that_cannot_be_read_is_named(command: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("CC", command)
    with pytest.raises(CompilerError, match="CC") as raised:
        c_build.find_compiler()
    assert repr(command) in str(raised.value)
