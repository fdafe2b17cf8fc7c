"""A diagnosis that takes a moment, called as the app calls its own: ``python -m ... CAMPAIGN OUT``.

A campaign whose title is "slow" takes a minute, and one whose title is "broken" ends without a result.
"""

from __future__ import annotations

import json
import os
import sys
import time
import tomllib
from pathlib import Path

from rigtwin.workers import end_with


def main() -> None:
    campaign, out = map(Path, sys.argv[1:3])
    end_with(0)
    title = tomllib.loads((campaign / "campaign.toml").read_text(encoding="utf-8"))["title"]
    (Path(os.environ["TMPDIR"]) / "left behind").write_text("by the process")
    for done in range(3):
        print(json.dumps({"done": done, "total": 3, "words": f"candidate {done}"}), flush=True)
        time.sleep(60.0 if title == "slow" else 0.1)
    if title == "broken":
        sys.exit("it fell down the stairs")
    (out / "report.html").write_text(f"<!DOCTYPE html><title>r</title><h1>{title}</h1>", encoding="utf-8")
    (out / "diagnosis.json").write_text(json.dumps({"title": title}), encoding="utf-8")
    print(json.dumps({"sentence": f"Pedestal flexibility at the bearings causes the gap of {title}."}), flush=True)


if __name__ == "__main__":
    main()
