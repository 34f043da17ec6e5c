"""Random programs against references that share nothing with the compiler: `python -m tests.fuzz.run -n 5000`, or `make fuzz N=5000`.

Prints each failure as a Python program, minimised, and a table of verdicts by kind. Results are kept in a file, line by line; a run that
was interrupted goes on from there (`--fresh`: from the start).
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
import sys
import time
from collections import Counter, defaultdict
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import asdict
from multiprocessing.connection import Connection, wait
from pathlib import Path
from typing import Any

BACKENDS = ("numpy", "c", "jax")
VERDICTS = ("right", "said", "wrong", "crash", "slow")
HARD = 3.0
"""How many times its limit a program may take before its process is ended."""

REFERENCES = "references.jsonl"
Record = dict[str, Any]


def examine(seed: int, backends: Sequence[str], limit: float, jax_every: int, stored: Mapping[str, Any]) -> Record:
    """One program in all backends; without backends its reference. `stored` has references that are there already."""
    from tests.fuzz.generate import program as of_seed
    from tests.fuzz.judge import agreement, digest, judge, known_of, worst

    started = time.perf_counter()
    program = of_seed(seed)
    record: Record = {"seed": seed, "kind": program.kind, "law": program.law}
    known = stored.get(digest(program)) or known_of(program, limit)
    if not backends:
        return {
            "digest": digest(program),
            "known": known if isinstance(known, str) else asdict(known),
            "seconds": time.perf_counter() - started,
        }
    record["reference"] = "" if not isinstance(known, str) else known[:80]
    record["slope"] = not isinstance(known, str) and known.slope is not None
    if isinstance(known, str) and not program.law:
        return {**record, "verdict": "skipped", "seconds": time.perf_counter() - started}
    judgements = {}
    for backend in backends:
        if backend == "jax" and seed % jax_every:
            continue
        judgements[backend] = (
            agreement(program, backend, limit)
            if isinstance(known, str)
            else judge(program, known, backend, limit * (3 if backend == "jax" else 1))
        )
    record["verdict"] = worst(list(judgements.values()))
    record["backends"] = {b: {"verdict": j.verdict, "what": j.what, "seconds": round(j.seconds, 3)} for b, j in judgements.items()}
    record["seconds"] = time.perf_counter() - started
    return record


def reduced(seed: int, backend: str, verdict: str, limit: float, seconds: float) -> str:
    """A failing program, minimised, as text."""
    from tests.fuzz.generate import program as of_seed
    from tests.fuzz.judge import agreement, judge, known_of, written
    from tests.fuzz.minimise import minimised
    from tests.fuzz.syntax import Program, as_python

    def judged(candidate: Program) -> Any:
        known = known_of(candidate, limit)
        if isinstance(known, str):
            return agreement(candidate, backend, limit) if candidate.law else None
        return judge(candidate, known, backend, limit)

    def fails(candidate: Program) -> bool:
        judgement = judged(candidate)
        return judgement is not None and judgement.verdict == verdict

    small = minimised(of_seed(seed), fails, seconds)
    judgement = judged(small)
    lines = (
        f"seed {seed}, {small.kind}{', law ' + small.law if small.law else ''}, {backend}: {verdict}",
        judgement.what if judgement else "",
    )
    return as_python(small.with_tree(written(small)) if small.law else small, backend, lines)


def _work(connection: Connection, backends: Sequence[str], limit: float, jax_every: int, references: Path) -> None:
    """A process that examines seeds, and reduces failures."""
    from tests.fuzz.judge import stored_references

    sys.setrecursionlimit(10_000)
    stored = stored_references(references)
    if "jax" in backends:
        import jax

        jax.config.update("jax_enable_x64", True)
    while (task := connection.recv()) is not None:
        if task[0] == "examine":
            connection.send(examine(task[1], backends, limit, jax_every, stored))
        else:
            connection.send({"text": reduced(*task[1:])})


class Worker:
    """A process, and its task."""

    def __init__(self, settings: tuple[Any, ...]) -> None:
        self.settings = settings
        self.start()

    def start(self) -> None:
        context = multiprocessing.get_context("spawn")
        self.connection, other = context.Pipe()
        self.process = context.Process(target=_work, args=(other, *self.settings), daemon=True)
        self.process.start()
        other.close()
        self.task: tuple[Any, ...] | None = None
        self.deadline = float("inf")

    def give(self, task: tuple[Any, ...], seconds: float) -> None:
        self.task, self.deadline = task, time.monotonic() + seconds
        self.connection.send(task)

    def end(self) -> None:
        self.process.kill()
        self.process.join()
        self.connection.close()


def spread(
    tasks: Iterable[tuple[Any, ...]], workers: int, settings: tuple[Any, ...], seconds: float
) -> Iterable[tuple[tuple[Any, ...], Record]]:
    """Results of tasks as they come; a task whose process had to be ended, or died, gives {"lost": why}."""
    pool = [Worker(settings) for _ in range(workers)]
    waiting = iter(tasks)
    try:
        for worker in pool:
            if (task := next(waiting, None)) is not None:
                worker.give(task, seconds)
        while any(w.task for w in pool):
            ready = wait([w.connection for w in pool if w.task], timeout=1.0)
            for worker in pool:
                if worker.task is None:
                    continue
                task, result = worker.task, None
                if worker.connection in ready:
                    try:
                        result = worker.connection.recv()
                    except (EOFError, OSError):
                        result = {"lost": f"the process ended with {worker.process.exitcode}"}
                elif time.monotonic() > worker.deadline:
                    result = {"lost": f"no answer in {seconds:g} s, not even to a signal"}
                if result is None:
                    continue
                if "lost" in result:
                    worker.end()
                    worker.start()
                worker.task = None
                if (following := next(waiting, None)) is not None:
                    worker.give(following, seconds)
                yield task, result
    finally:
        for worker in pool:
            worker.end()


def table(records: Sequence[Record]) -> str:
    """Verdicts by kind, in percent of the programs that were judged."""
    by_kind: dict[str, Counter[str]] = defaultdict(Counter)
    for record in records:
        by_kind[record["kind"]][record["verdict"]] += 1
    lines = ["| | programs | " + " | ".join(VERDICTS) + " | no reference |", "|---" * (len(VERDICTS) + 3) + "|"]
    total: Counter[str] = Counter()
    for kind, counts in sorted(by_kind.items()):
        total += counts
        lines.append(_line(kind, counts))
    lines.append(_line("all", total))
    return "\n".join(lines)


def _line(name: str, counts: Counter[str]) -> str:
    judged = sum(counts[v] for v in VERDICTS)
    shares = [f"{100 * counts[v] / judged:.1f} %" if judged and counts[v] else "–" for v in VERDICTS]
    return f"| {name} | {judged} | " + " | ".join(shares) + f" | {counts['skipped']} |"


def by_backend(records: Sequence[Record]) -> str:
    counts: dict[str, Counter[str]] = defaultdict(Counter)
    for record in records:
        for backend, judgement in record.get("backends", {}).items():
            counts[backend][judgement["verdict"]] += 1
    return "\n".join(f"{b}: " + ", ".join(f"{c[v]} {v}" for v in VERDICTS) for b, c in sorted(counts.items()))


def arguments(argv: Sequence[str] | None = None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("-n", type=int, default=300, help="how many programs")
    parser.add_argument("--start", type=int, default=0, help="the first seed")
    parser.add_argument("--backends", default=",".join(BACKENDS))
    parser.add_argument("--jax-every", type=int, default=10, help="JAX sees every n-th program: XLA takes seconds for each")
    parser.add_argument("--limit", type=float, default=20.0, help="seconds for one program in one backend")
    parser.add_argument("--workers", type=int, default=os.cpu_count() or 1)
    parser.add_argument("--minimise", type=int, default=20, help="how many failures are minimised and printed")
    parser.add_argument("--minimise-seconds", type=float, default=60.0)
    parser.add_argument("-o", "--out", type=Path, default=Path("out/fuzz"))
    parser.add_argument("--references", action="store_true", help="only compute references, and keep them in the folder")
    parser.add_argument("--fresh", action="store_true")
    return parser.parse_args(argv)


def main(argv: Sequence[str] | None = None) -> int:
    given = arguments(argv)
    os.environ.setdefault("OMP_NUM_THREADS", "1")
    given.out.mkdir(parents=True, exist_ok=True)
    if given.references:
        return _keep_references(given)
    backends = tuple(given.backends.split(","))
    path = given.out / f"verdicts-{given.start}.jsonl"
    if given.fresh:
        path.unlink(missing_ok=True)
    records = _earlier(path, given.start, given.n)
    done = {r["seed"] for r in records}
    seeds = [s for s in range(given.start, given.start + given.n) if s not in done]
    settings = (backends, given.limit, given.jax_every, given.out / REFERENCES)
    last = time.monotonic()
    with path.open("a") as file:
        tasks = [("examine", s) for s in seeds]
        for task, result in spread(tasks, given.workers, settings, HARD * given.limit * (3 + 3 * len(backends))):
            if "lost" in result:
                result = _lost(task[1], result["lost"])
            records.append(result)
            file.write(json.dumps(result) + "\n")
            file.flush()
            if time.monotonic() - last > 60:
                last = time.monotonic()
                print(
                    f"{len(records)} of {given.n}: " + ", ".join(f"{k} {v}" for k, v in Counter(r["verdict"] for r in records).items()),
                    flush=True,
                )
    print(table(records), "", by_backend(records), sep="\n")
    failures = [r for r in sorted(records, key=lambda r: r["seed"]) if r["verdict"] in ("wrong", "crash")]
    _print_failures(failures[: given.minimise], given, settings)
    return 1 if failures else 0


def _keep_references(given: argparse.Namespace) -> int:
    """Computes references, which do not depend on the compiler, ahead of a run."""
    from tests.fuzz.generate import program as of_seed
    from tests.fuzz.judge import digest, stored_references

    path = given.out / REFERENCES
    stored = stored_references(path)
    seeds = [s for s in range(given.start, given.start + given.n) if digest(of_seed(s)) not in stored]
    with path.open("a") as file:
        for _, result in spread([("examine", s) for s in seeds], given.workers, ((), given.limit, 1, path), HARD * given.limit):
            if "lost" not in result:
                file.write(json.dumps(result) + "\n")
                file.flush()
    return 0


def _print_failures(failures: Sequence[Record], given: argparse.Namespace, settings: tuple[Any, ...]) -> None:
    tasks = []
    for record in failures:
        backend, judgement = next((b, j) for b, j in record["backends"].items() if j["verdict"] == record["verdict"])
        tasks.append(("reduce", record["seed"], backend, judgement["verdict"], given.limit / 2, given.minimise_seconds))
    for task, result in spread(tasks, given.workers, settings, given.minimise_seconds + 20 * given.limit):
        text = result.get("text") or f"# seed {task[1]}: {result.get('lost')}"
        print(f"\n{text}", flush=True)
        (given.out / f"seed-{task[1]}.py").write_text(text + "\n")


def _lost(seed: int, why: str) -> Record:
    from tests.fuzz.generate import program as of_seed

    verdict = "slow" if why.startswith("no answer") else "crash"
    program = of_seed(seed)
    judgement = {"verdict": verdict, "what": why, "seconds": 0.0}
    return {"seed": seed, "kind": program.kind, "law": program.law, "verdict": verdict, "backends": {"numpy": judgement}, "seconds": 0.0}


def _earlier(path: Path, start: int, n: int) -> list[Record]:
    if not path.exists():
        return []
    found = {}
    for line in path.read_text().splitlines():
        try:
            record = json.loads(line)
        except json.JSONDecodeError:
            continue
        if start <= record["seed"] < start + n:
            found[record["seed"]] = record
    return list(found.values())


if __name__ == "__main__":
    sys.exit(main())
