"""Writes the generated part of docs/canopen.md: ``python -m tests.master.patches.patch_table_doc``."""

from pathlib import Path

from skinbus.master.alarms import CLEARED_BY, RAISED_BY
from skinbus.master.patches.table import TRANSITIONS, PatchState

DOC = Path(__file__).parents[3] / "docs" / "canopen.md"
BEGIN, END = "<!-- generated: patch table -->", "<!-- end -->"


def generated() -> str:
    """The states, transitions and EMCY codes as the code has them."""
    lines = ["| value | state |", "|---|---|"]
    lines += [f"| {state.value} | {state.name} |" for state in PatchState]
    lines += ["", "| from | to | when |", "|---|---|---|"]
    lines += [f"| {before.name} | {after.name} | {why} |" for (before, after), why in TRANSITIONS.items()]
    lines += ["", "| event | EMCY | cleared by |", "|---|---|---|"]
    for event, code in RAISED_BY.items():
        ends = ", ".join(f"`{end}`" for end, codes in CLEARED_BY.items() if code in codes)
        lines.append(f"| `{event}` | 0x{code:04X} | {ends} |")
    return "\n".join(lines)


def main() -> None:
    """Put the generated part into the document."""
    head, _, rest = DOC.read_text().partition(BEGIN)
    _, _, tail = rest.partition(END)
    DOC.write_text(f"{head}{BEGIN}\n{generated()}\n{END}{tail}")


if __name__ == "__main__":
    main()
