"""The process that diagnoses for the app: ``python -m rigtwin.app.worker CAMPAIGN OUT``.

It prints a JSON document for every step, {"done", "total", "words"}, and in the end {"sentence"} or {"error"}; it ends
when its stdin is closed, as it is when the app ends.
"""

from __future__ import annotations

import json
import os
import signal
import sys
from pathlib import Path
from typing import IO

from rigtwin.errors import UserError
from rigtwin.scale_out import ONE_THREAD
from rigtwin.workers import end_with


def main() -> int:
    """Diagnose; returns the exit code of the process."""
    campaign, out = map(Path, sys.argv[1:3])
    signal.signal(signal.SIGINT, signal.SIG_IGN)  # Ctrl-C is for the app
    for name, value in ONE_THREAD.items():
        os.environ.setdefault(name, value)
    told = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)  # what an FMU prints is no step
    end_with(0)
    return run(campaign, out, told)


def run(campaign: Path, out: Path, told: IO[str]) -> int:
    """Diagnose a campaign and write its page; whatever is wrong with it is told in a sentence."""

    def tell(**document: object) -> None:
        print(json.dumps(document), file=told, flush=True)

    from rigtwin.api.diagnoses import diagnose

    try:
        found = diagnose(
            campaign, workers=None, progress=lambda done, total, words: tell(done=done, total=total, words=words)
        )
        found.save(out)
    except UserError as error:
        tell(error=str(error).replace(f"{campaign}{os.sep}", "").replace(str(campaign), "the campaign"))
        return 2
    tell(sentence=found.sentence)
    return 0


if __name__ == "__main__":
    sys.exit(main())
