"""A proposed field as a file, with what is to be filled in."""

from testfield.measure.proposed_field import Proposal


def field_text(proposal: Proposal, target: dict[str, str | bool], title: str) -> str:
    """The field file, as TOML with what is to be filled in."""
    a, b, length = proposal.longest
    lines = [
        f"# Proposed by `testfield field new` from photographs of {title}.",
        f'name = "{_quoted(title)}"',
        "",
        "[target]",
        *(
            f"{key} = {str(value).lower() if isinstance(value, bool) else _text(value)}"
            for key, value in target.items()
        ),
        "",
        "# ---- THE SCALE IS TO BE FILLED IN ----",
        "# Nothing in photographs tells a length. Measure one distance between two codes, from centre to centre, take",
        "# away the marks # below and write it in, with its standard uncertainty. The longer the better: these two are",
        f"# the farthest apart on one board, {length:.1f} in the unit of the places below.",
        "# [[distances]]",
        f"# codes = [{a}, {b}]",
        "# length_mm = ",
        "# u_mm = 0.1",
        "",
        "# Boards, by codes that moved rigidly together or lie in one plane. Places are approximate, in a unit of",
        "# their own (all codes extend over 1000), and certify nothing: rename, join or divide boards as you like.",
        "# Codes that stand in no board are measured like others; codes that no photograph shows may stay.",
    ]
    if not proposal.arranged.moved:
        lines.append("# All boards stood still to each other in all photographs.")
    for group in proposal.groups:
        flat = f"{len(group.code)} codes, flat to {group.flat_rms:.2g}" if len(group.code) > 3 else ""
        body = f"; moves with: body {group.body + 1}" if proposal.arranged.moved else ""
        lines += [
            "",
            f"[[groups]]  # {flat}{body}" if flat or body else "[[groups]]",
            f'name = "{group.name}"',
            f"u = {group.u:.3g}",
            "points = [",
            *(
                f"  {{ code = {c}, xyz = [{', '.join(f'{v:.2f}' for v in xyz)}] }},"
                for c, xyz in zip(group.code, group.xyz, strict=True)
            ),
            "]",
        ]
    return "\n".join(lines) + "\n"


def _quoted(text: str) -> str:
    return text.replace("\\", "\\\\").replace('"', '\\"')


def _text(value: object) -> str:
    return f'"{_quoted(str(value))}"'
