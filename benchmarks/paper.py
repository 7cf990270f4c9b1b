"""Rerun the study of the paper and write docs/paper.md with its tables and figures beside ours.

setup/run python benchmarks/paper.py            (an hour; DeepXDE alone 30,000 iterations three times)
setup/run python benchmarks/paper.py --quick    (every row once, reduced, below three minutes)
"""

from __future__ import annotations

import argparse
import os
from functools import partial
from pathlib import Path

from peers.process import SINGLE_CORE

ROOT = Path(__file__).resolve().parent.parent


def main() -> None:
    """Run, and write the page and its pictures."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--quick", action="store_true", help="every row once, at reduced size")
    parser.add_argument("--out", type=Path, default=ROOT / "docs", help="folder of paper.md (default: %(default)s)")
    data = ROOT.parent / "shared" / "data"
    parser.add_argument("--data", type=Path, default=data, help="folder of public recordings (default: %(default)s)")
    args = parser.parse_args()
    os.environ.update(SINGLE_CORE)
    import torch

    torch.set_num_threads(1)
    from reproduction import cases, figures, page, study

    size, tell = (study.QUICK if args.quick else study.FULL), partial(print, flush=True)
    table_2, table_4 = study.table_2(size, tell), study.table_4(size, tell)
    results = page.Results(
        size, table_2, table_4, study.table_5(size, tell), study.stiff(size, tell),
        {case.model.name: study.shown(case) for case in (cases.model_1(), cases.model_3())},
        study.eager_epochs(tell) if size.eager else {}, study.log(args.data, size.log_s, tell),
    )  # fmt: skip
    images = args.out / "images"
    figures.step(cases.model_3(), images / "paper_fig4.png")
    figures.training([r for r in table_2 if (r.labels, r.samples) == ("2", 700)], images / "paper_fig6.png")
    figures.training([r for r in table_4 if r.labels == "5 + torsion"], images / "paper_fig7.png")
    figures.motion(results.table_5, images / "paper_fig8.png")
    (args.out / "paper.md").write_text(page.page(results))
    print(f"wrote {args.out / 'paper.md'}")


if __name__ == "__main__":
    main()
