"""A check in words: a table for the terminal, JUnit's XML for CI, a Markdown summary for a pull request."""

import re
from collections import Counter
from collections.abc import Sequence
from pathlib import Path
from xml.etree import ElementTree

import numpy as np

from testfield.evaluate.regress.check import by_weight
from testfield.evaluate.regress.verdict import FAILING, Finding, Verdict
from testfield.report.style import ACCENT, FAINT, INK, WARM, figure
from testfield.store.atomic import whole
from testfield.store.text import write_text

JUNIT = {verdict: "failure" for verdict in FAILING} | {Verdict.UNKNOWN: "error", Verdict.OTHER_MACHINE: "skipped"}
"""What JUnit calls a test with a verdict; none of the others."""
NOT_IN_XML = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""What XML 1.0 cannot hold, as the colours of a program's last words."""
PICTURED = 3
MOST_ROWS = 40
"""Rows of the summary's table; a pull request is read, not searched."""


def counted(findings: Sequence[Finding]) -> str:
    """How many figures have which verdict."""
    numbers = Counter(one.verdict for one in findings)
    exactly = sum(one.identical for one in findings)
    said = ", ".join(f"{numbers[verdict]} {verdict.value}" for verdict in Verdict if numbers[verdict])
    return f"{said} ({exactly} of {len(findings)} figures the same to the last digit)"


def lines_of(findings: Sequence[Finding], whole_table: bool = False) -> list[str]:
    """What is no pass, a line each, the worst first; with `whole_table` everything."""
    shown = list(findings) if whole_table else by_weight(findings)
    rows = [(one.verdict.value, " / ".join(one.name), said_of(one)) for one in shown]
    width = [max((len(row[k]) for row in rows), default=0) for k in range(2)]
    return [f"{verdict:<{width[0]}}  {name:<{width[1]}}  {said}" for verdict, name, said in rows]


def said_of(finding: Finding) -> str:
    """Before and now, the difference with its interval, what matters, and in how many draws."""
    if finding.verdict in (Verdict.MISSING, Verdict.NOT_A_NUMBER):
        return finding.detail
    d = finding.difference
    if finding.identical:
        return f"{np.mean(finding.now):.4g}, the same to the last digit in {d.draws} draws"
    change = f"{np.mean(finding.base):.4g} -> {np.mean(finding.now):.4g}, difference {d.value:+.3g}"
    ends = f" [{d.low:+.3g}, {d.high:+.3g}]" if np.isfinite([d.low, d.high]).all() else ""
    more = f"; {finding.detail}" if finding.detail else ""
    return f"{change}{ends}, {finding.matters:.3g} matters, {d.draws} draws{more}"


def write_junit(findings: Sequence[Finding], suite: str, path: Path) -> None:
    """JUnit's XML: a test suite for each scene and recipe, a test for each figure."""
    top = ElementTree.Element("testsuites", name=f"testfield regress {suite}")
    for scene, recipe in dict.fromkeys(one.name[:2] for one in findings):
        own = [one for one in findings if one.name[:2] == (scene, recipe)]
        counts: dict[str, str] = {
            "tests": str(len(own)),
            "failures": str(sum(one.verdict in FAILING for one in own)),
            "errors": str(sum(one.verdict is Verdict.UNKNOWN for one in own)),
            "skipped": str(sum(one.verdict is Verdict.OTHER_MACHINE for one in own)),
        }
        group = ElementTree.SubElement(top, "testsuite", {"name": f"{scene}, {recipe}"} | counts)
        for one in own:
            test = ElementTree.SubElement(
                group, "testcase", classname=f"{suite}.{scene}.{recipe}", name=one.figure.key, time="0"
            )
            kind = JUNIT.get(one.verdict)
            told = NOT_IN_XML.sub("?", f"{one.verdict.value}: {said_of(one)}")
            if kind is None:
                ElementTree.SubElement(test, "system-out").text = told
            else:
                ElementTree.SubElement(test, kind, {"message": told, "type": one.verdict.value})
    ElementTree.indent(top)
    with whole(path) as part:
        write_text(part, ElementTree.tostring(top, "unicode", xml_declaration=True) + "\n")


def write_markdown(findings: Sequence[Finding], suite: str, notes: Sequence[str], path: Path) -> None:
    """A summary for a pull request, with pictures of the worst changes beside it."""
    ranked = by_weight(findings)
    verdicts = {one.verdict for one in findings}
    word = "fails" if verdicts & set(FAILING) else "is undecided" if Verdict.UNKNOWN in verdicts else "passes"
    lines = [f"## Regression suite `{suite}` {word}", "", f"{counted(findings)}.", *(f"\n{note}" for note in notes)]
    if ranked:
        lines += ["", "| verdict | scene | recipe | figure | before → now | difference, interval | matters | draws |"]
        lines += ["|---|---|---|---|---|---|---|---|", *(_row(one) for one in ranked[:MOST_ROWS])]
        if len(ranked) > MOST_ROWS:
            lines += ["", f"{len(ranked) - MOST_ROWS} more are in the XML beside this file."]
    pictured = [one for one in ranked if one.difference.draws and one.verdict is not Verdict.UNKNOWN][:PICTURED]
    for k, one in enumerate(pictured, 1):
        name = f"worst_{k}.png"
        with whole(path.with_name(name)) as part:
            draw(one, part)
        lines += ["", f"![{one.verdict.value}: {', '.join(one.name)}]({name})"]
    for k in range(len(pictured) + 1, PICTURED + 1):
        path.with_name(f"worst_{k}.png").unlink(missing_ok=True)
    with whole(path) as part:
        write_text(part, "\n".join(lines) + "\n")


def _row(one: Finding) -> str:
    cells = [f"**{one.verdict.value}**", one.scene, one.recipe, f"`{one.figure.key}`"]
    if one.difference.draws:
        d = one.difference
        cells += [f"{np.mean(one.base):.4g} → {np.mean(one.now):.4g}"]
        cells += [f"{d.value:+.3g} [{d.low:+.3g}, {d.high:+.3g}]", f"{one.matters:.3g}", str(d.draws)]
    else:
        cells += [one.detail, "", "", ""]
    return f"| {' | '.join(cell.replace('|', '/') for cell in cells)} |"


def draw(finding: Finding, path: Path) -> None:
    """A picture of a change: each draw's value before and now, joined, and the mean difference with its interval
    against the band of what does not matter."""
    n, d, m = len(finding.now), finding.difference, finding.matters
    with figure(6.4, 2.5, 2, width_ratios=[1.7, 1]) as (drawing, (left, right)):
        at = np.arange(1, n + 1)
        left.vlines(at, finding.base, finding.now, color=FAINT, linewidth=1)
        left.plot(at, finding.base, "o", color=ACCENT, markersize=4, label="baseline")
        left.plot(at, finding.now, "o", color=WARM, markersize=4, label="now")
        left.set_xlabel("draw of noise")
        left.set_title(finding.figure.key, fontsize=8.5, loc="left")
        left.xaxis.get_major_locator().set_params(integer=True)
        left.legend(frameon=False, fontsize=7.5, loc="best")
        right.axvspan(-m, m, color=FAINT, alpha=0.35, linewidth=0)
        right.axvline(0, color=INK, linewidth=0.8)
        right.plot(finding.now - finding.base, np.linspace(-0.25, -0.75, n), ".", color=FAINT, markersize=4)
        if np.isfinite([d.low, d.high]).all():
            right.plot([d.low, d.high], [0, 0], color=WARM, linewidth=2)
        right.plot([d.value], [0], "o", color=WARM, markersize=5)
        right.set_ylim(-1, 0.6)
        right.set_yticks([])
        right.set_xlabel("now minus baseline")
        right.set_title("in the band it does not matter", fontsize=7.5, loc="left")
        right.locator_params(axis="x", nbins=3)
        drawing.suptitle(f"{finding.verdict.value}: {finding.scene}, {finding.recipe}", fontsize=8.5, x=0.01, ha="left")
        drawing.savefig(path, format="png", dpi=130, metadata={"Software": None})
