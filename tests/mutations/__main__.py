"""Plants single changes in a bundle's files and counts those that the product misses.

    python -m tests.mutations build/go1 --count 200
    python -m tests.mutations build/go1 --rewrite

Without `--format` all formats are changed. With `--rewrite` files are only written differently;
every finding is then a false alarm and the exit code is 1.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections import Counter
from collections.abc import Iterator, Sequence
from pathlib import Path

from tests.mutations.bundle import FORMATS, files_of, form_of
from tests.mutations.run import Result, sample, try_all


def main(words: Sequence[str] | None = None) -> int:
    """Prints what was found; the exit code is 1 only where `--rewrite` found something."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("bundle", type=Path, nargs="+")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--count", type=int, default=200, help="mutations of each format")
    parser.add_argument("--format", choices=FORMATS, action="append")
    parser.add_argument("--rewrite", action="store_true", help="write the files anew, same meaning")
    chosen = parser.parse_args(words)
    began = time.monotonic()
    alarms = 0
    for bundle in chosen.bundle:
        if chosen.rewrite:
            alarms += false_alarms(bundle)
            continue
        there = {form_of(file) for file in files_of(bundle)}
        forms = [form for form in chosen.format or FORMATS if form in there]
        drawn = sample(bundle, forms, chosen.seed, chosen.count)
        results = list(try_all(bundle, drawn))
        print(f"\n# {bundle.name}, {(time.monotonic() - began):.0f} s so far\n")
        print(*rows(results), *missed(results), sep="\n", flush=True)
    return 1 if alarms else 0


def rows(results: Sequence[Result]) -> Iterator[str]:
    """A line for each format: what became of its changes, and what each judge said of those."""
    for form in FORMATS:
        own = [one for one in results if form_of(one.mutation.file) == form]
        tried = [one.verdict for one in own if one.verdict]
        judges = [
            f"{judge} {dict(Counter(getattr(verdict, judge) for verdict in tried))}"
            for judge in ("validate", "diff")
        ]
        if own:
            yield f"{form}: {dict(Counter(one.fate for one in own))}; {'; '.join(judges)}"


def missed(results: Sequence[Result]) -> Iterator[str]:
    """A line for each change that `validate` or `diff` did not find."""
    for one in results:
        if one.verdict and (one.verdict.validate, one.verdict.diff) != ("found", "found"):
            verdict = f"validate {one.verdict.validate}, diff {one.verdict.diff}"
            yield f"- {one.mutation}: {verdict} {' '.join(one.verdict.said[:1])[:160]}"


def false_alarms(bundle: Path) -> int:
    """Prints and counts what is found in files that were only written differently."""
    from tests.mutations.rewrite import rewritten

    count = 0
    for file, said in rewritten(bundle):
        count += len(said)
        print(f"{bundle.name}: {file}: {'; '.join(said[:3]) or 'nothing found'}", flush=True)
    return count


if __name__ == "__main__":
    sys.exit(main())
