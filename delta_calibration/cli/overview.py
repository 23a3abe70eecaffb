"""What `delta-cal --help` shows: the verbs by purpose, an example of each."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import click

# purpose: verb and an example of its arguments, in the order of use
PURPOSES: Mapping[str, Mapping[str, str]] = {
    "Measure": {
        "plan": "--robot srbd --identify --out poses.csv",
        "simulate": "--robot srbd --effect backlash:strength=1 --out session",
        "import": "table.csv --mapping mapping.yaml --robot srbd --out session",
    },
    "Look": {
        "info": "session",
        "check": "session --robot srbd --fix mended",
        "recover": "session --out whole",
        "replay": "session --rate 10",
        "urdf": "--robot srbd --out srbd.urdf",
        "robot": "draw srbd --out srbd.svg",
    },
    "Find out": {
        "fit": "session --robot srbd --out calibration.yaml",
        "diagnose": "session --robot srbd --json verdict.json --out extended.yaml",
        "circle": "session --robot srbd --json circles.json --report circles.html",
        "printer": "printer.cfg --out identified.cfg",
    },
    "Put right": {
        "compensate": "--robot srbd --calibration extended.yaml points.csv --out joints.csv",
        "export": "--robot srbd --calibration extended.yaml --format c --out machine.c",
    },
    "Judge and sign": {
        "iso9283": "session --robot srbd --json iso.json",
        "report": "session --robot srbd --out report.html",
        "certificate": "session --robot srbd --about about.yaml --out certificate.pdf",
        "compare": "january.json june.json --out drift.html",
        "history": "changes --machine press_3",
        "fleet": "machines --scheduler tcp://host:8786",
    },
    "Protect": {
        "sros2": "--policy --out policy.xml",
    },
    "Begin": {
        "demo": "--out out/demo",
        "serve": "--data bench",
        "completion": "bash",
    },
}

Find = Callable[[str], click.Command | None]


def write_verbs(formatter: click.HelpFormatter, verbs: Sequence[str], find: Find) -> None:
    """The verbs under their purposes; those that have none come last."""
    told = {verb for examples in PURPOSES.values() for verb in examples}
    rest = {verb: "--help" for verb in verbs if verb not in told}
    for purpose, examples in {**PURPOSES, "More": rest}.items():
        here = {verb: text for verb, text in examples.items() if verb in verbs}
        if here:
            with formatter.section(purpose):
                _write(formatter, here, find)


def _write(formatter: click.HelpFormatter, examples: Mapping[str, str], find: Find) -> None:
    for verb, example in examples.items():
        command = find(verb)
        said = "" if command is None else command.get_short_help_str(limit=200)
        formatter.write(f"{'':{formatter.current_indent}}{verb:<12}{said}\n")
        formatter.write(f"{'':{formatter.current_indent + 4}}$ delta-cal {verb} {example}\n")
