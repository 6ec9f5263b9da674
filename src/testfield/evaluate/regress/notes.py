"""What a reader of a check must know besides its verdicts."""

from testfield.evaluate.regress.baseline import Baseline, made_here
from testfield.evaluate.regress.check import Checked
from testfield.evaluate.regress.suite import Suite


def notes_of(suite: Suite, baseline: Baseline, found: Checked) -> list[str]:
    """Sentences: what is different here from where the baseline was recorded, and how many draws were looked at."""
    here, there = made_here(suite), baseline.made
    notes = [f"Baseline of {there.get('made', '?')}, commit {str(there.get('commit') or 'unknown')[:12]}."]
    if any(there.get(key) != here[key] for key in ("processor", "target")):
        said = [" ".join(filter(None, (str(one.get("processor")), str(one.get("target"))))) for one in (there, here)]
        notes.append(
            f"Another machine: recorded on {said[0]}, checked on {said[1]}; times and memory are not compared, and the "
            "suite's `arithmetic` is allowed to all other figures."
        )
    if there.get("renderer") != here["renderer"]:
        notes.append("Renderer or sensor have changed since: differences are those of the images, too.")
    before = there.get("versions") or {}
    changed = [
        f"{name} {before.get(name)} -> {now}" for name, now in here["versions"].items() if before.get(name) != now
    ]
    if changed:
        notes.append(f"Other versions: {', '.join(changed)}.")
    notes.append(f"Draws of noise at each look: {', '.join(map(str, found.looks))}.")
    return notes
