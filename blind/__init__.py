"""Blind campaigns for the diagnosis of the gap, their sealed labels, and the scorer.

A second implementation on purpose: it imports nothing of the diagnosis, its rotor model, its rig or its FMUs.

| module         | what it is responsible for                                                   | entry point         |
| -------------- | ---------------------------------------------------------------------------- | ------------------- |
| `rig`          | geometry from the rig's TOML                                                 | `read_rig`          |
| `beam`         | Timoshenko shaft in spectral elements                                        | `build_shaft`       |
| `effects`      | what may be hidden: ids, ranges, places, how they fade                       | `KINDS`             |
| `strangers`    | five mechanisms in nobody's library (W8), with their equations               | `ADDERS`            |
| `forms`        | effects in other functional forms (W6)                                       | `FORMS`             |
| `machine`      | matrices of a rotor with effects; drift of its resonances                    | `build_machine`     |
| `response`     | steady response through the measurement chain                                | `reported`          |
| `transient`    | a sweep that does not settle                                                 | `swept`             |
| `laws`         | nonlinear force laws, sampled over a period                                  | `law_of`            |
| `nonlinear`    | harmonic balance, stability, time stepping, upward sweeps, force levels      | `swept_up`          |
| `lines`        | frequency lines as a lab chooses them                                        | `choose_lines`      |
| `case`         | one campaign before it is written: hidden rig and test plan                  | `Case`, `measure`   |
| `detection`    | distance from the nearest campaign without the effect; detection limit       | `Distance`          |
| `sizes`        | size of an effect over its detection limit                                   | `size_ratio`        |
| `draw`         | what each set draws, and the label                                           | `draw_campaign`     |
| `folder`       | campaign folders and truth on disk                                           | `write_campaign`    |
| `generate`     | campaigns made by worker processes, resuming, sealing                        | `make_all`          |
| `statistics`   | Wilson intervals, AUROC, Brier score, calibration error                      | `Rate`              |
| `score`        | diagnoses against labels; figures of groups                                  | `read_outcomes`     |
| `bars`         | what has to be reached, and whether it is                                    | `bars`              |
| `page`         | the page of the benchmark                                                    | `page`              |
| `results`      | judged campaigns as rows of JSON                                             | `to_row`            |

`data/` holds cases made by other codes.
"""

SETS = ("W1", "W2", "W3", "W4", "W5", "W6", "W7", "W8")
