"""`testfield codes`: the ring codes' tables, and sets of numbers that are hard to take for one another."""

import argparse
from typing import Any


def add(commands: Any) -> None:
    """Enter the command."""
    p = commands.add_parser(
        "codes",
        help="list the ring codes, or choose numbers for a board",
        description="Lists the valid words of a ring code by number, read clockwise in the image, most significant bit "
        "first, in their smallest rotation. With --choose, a set with a large mutual distance.",
    )
    p.add_argument("--bits", type=int, metavar="N", help="segments of the ring: 8, 10, 12, 14, 16 or 20 (default: 14)")
    p.add_argument("--table", metavar="FILE", help="list and check a maker's own table, or a shipped one by its name")
    p.add_argument("--choose", type=int, metavar="N", help="choose so many numbers instead")
    p.add_argument("--ignore-mirrors", action="store_true", help="do not keep mirrored readings apart as well")
    p.add_argument("--json", action="store_true", help="print one JSON object")
    p.set_defaults(act=act)


def act(args: argparse.Namespace) -> int:
    """Print the counts, a table, or a set."""
    import json

    from testfield.errors import TestfieldError
    from testfield.targets.code_sets import choose_codes, mirrored, repeats
    from testfield.targets.ring_code import BITS, code_words, number_of_word

    if args.table is not None:
        return _table(args)
    if args.bits is not None and args.bits not in BITS:
        raise TestfieldError(
            f"ring codes have {', '.join(map(str, BITS))} bits, not {args.bits}", "--bits", "choose one of them"
        )
    bits = args.bits or 14
    if args.choose is not None:
        try:
            numbers, distance = choose_codes(bits, args.choose, not args.ignore_mirrors)
        except ValueError as error:
            raise TestfieldError(str(error), "--choose", "ask for fewer, or for more bits") from error
        if args.json:
            print(json.dumps({"bits": bits, "least_distance": distance, "numbers": numbers.tolist()}))
        else:
            print(f"{len(numbers)} codes of {bits} bits, at least {distance} segments apart:")
            print(" ".join(map(str, numbers.tolist())))
        return 0
    if args.bits is None and not args.json:
        for b in BITS:
            print(f"{b:>3} bits  {len(code_words(b)):>6} codes")
        print("testfield codes --bits N lists them")
        return 0
    words = code_words(bits)
    other = number_of_word(mirrored(words, bits), bits)
    if args.json:
        rows = [f"{word:0{bits}b}" for word in words.tolist()]
        print(json.dumps({"bits": bits, "count": len(words), "words": rows, "mirrored": other.tolist()}))
        return 0
    print(f"# {len(words)} codes of {bits} bits: number, word clockwise, number if read the wrong way round")
    for number, (word, wrong, turns) in enumerate(
        zip(words.tolist(), other.tolist(), repeats(words, bits).tolist(), strict=True), 1
    ):
        print(f"{number:>6}  {word:0{bits}b}  {wrong:>6}{'  repeats itself' if turns else ''}")
    return 0


def _table(args: argparse.Namespace) -> int:
    import json

    from testfield.errors import TestfieldError
    from testfield.targets.code_table import load_code_table, table_path

    if args.bits is not None or args.choose is not None:
        option = "--bits" if args.bits is not None else "--choose"
        raise TestfieldError("this option does not apply to a table", option, "leave it out")
    table = load_code_table(table_path(args.table))
    mirrored = {a: b for pair in table.mirrored for a, b in (pair, pair[::-1])}
    words = [f"{word:0{table.bits}b}" for word in table.words]
    if args.json:
        print(json.dumps({"bits": table.bits, "count": len(words), "mirrored": table.mirrored} | table.sheet()))
        return 0
    print(f"# {len(words)} codes of {table.bits} bits: number, word clockwise, number if read the wrong way round")
    print(f"# {table.name}; source: {table.source or 'not said'}")
    for number, word in zip(table.numbers, words, strict=True):
        print(f"{number:>6}  {word}  {mirrored.get(number, 0):>6}")
    return 0
