"""What is kept of sources is what looking again would find, or it is looked at again."""

import json
from pathlib import Path

import pytest

from testfield.store import code
from testfield.store.looked_at import LookedAt


def of(path: Path, by: bytes, asked: list[bytes]) -> LookedAt:
    def look(source: bytes) -> list[int]:
        asked.append(source)
        return [len(source)]

    return LookedAt(path, by, look)


def test_a_source_is_looked_at_once_and_again_when_who_looks_has_changed(tmp_path: Path) -> None:
    asked: list[bytes] = []
    first = of(tmp_path / "kept.json", b"1", asked)
    assert [first.at(text) for text in (b"a", b"bc", b"a")] == [[1], [2], [1]]
    first.keep()
    again = of(tmp_path / "kept.json", b"1", asked)
    assert again.at(b"bc") == [2] and asked == [b"a", b"bc"]
    changed = of(tmp_path / "kept.json", b"2", asked)
    assert changed.at(b"bc") == [2] and asked == [b"a", b"bc", b"bc"]


@pytest.mark.parametrize("text", ["", "{", "[]", '{"of": 1}', '{"of": "OWN", "found": 3}', "\x00\xff"])
def test_a_damaged_file_is_as_good_as_none(text: str, tmp_path: Path) -> None:
    path = tmp_path / "kept.json"
    asked: list[bytes] = []
    kept = of(path, b"1", asked)
    path.write_text(text.replace("OWN", kept.of))
    assert kept.at(b"abc") == [3] and asked == [b"abc"]
    kept.keep()
    assert json.loads(path.read_text())["of"] == kept.of


def test_where_nothing_can_be_written_all_is_looked_at(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("no folder")
    asked: list[bytes] = []
    kept = of(tmp_path / "file" / "kept.json", b"1", asked)
    assert kept.at(b"a") == [1]
    kept.keep()


def test_digests_and_imports_are_the_same_from_what_is_kept(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    def told() -> tuple[str, set[Path]]:
        code.code_digest.cache_clear()
        module = "testfield.detect.detect"
        return code.code_digest(module), code.sources((module,))

    kept = LookedAt(tmp_path / "kept.json", b"1", code._look)
    monkeypatch.setattr(code, "_looked_at", lambda: kept)
    fresh = told()
    assert len(fresh[1]) > 20 and (tmp_path / "kept.json").is_file()
    second = LookedAt(tmp_path / "kept.json", b"1", lambda source: pytest.fail("looked at again"))
    monkeypatch.setattr(code, "_looked_at", lambda: second)
    assert told() == fresh
    code.code_digest.cache_clear()
