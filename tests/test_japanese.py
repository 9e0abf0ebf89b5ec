"""Japanese users get whole sentences in Japanese; machine-readable output stays English."""

from __future__ import annotations

import ast
import gettext
import io
import re
import string
import subprocess
import sys
from collections.abc import Callable, Iterator
from pathlib import Path

import drop_physics
import pytest
from conftest import Drop
from drawn import is_within
from drop_physics import Analysis, analyze
from drop_physics.drop.findings import ALL_RULES
from drop_physics.errors import RecordingError
from drop_physics.fields import counted
from drop_physics.figures import style
from drop_physics.figures.panel_plot import build_figure, render
from drop_physics.figures.theme import LIGHT
from drop_physics.messages import LOCALE, VARIABLES, Message, joined, localized, translated, wrapped
from drop_physics.rules.reference import references
from drop_physics.stages.panels import plot_of
from drop_physics.stages.run import Run
from fontTools.fontBuilder import FontBuilder
from fontTools.pens.ttGlyphPen import TTGlyphPen
from generators.translations import TEMPLATES, templates
from matplotlib import font_manager
from matplotlib.text import Text
from rich.cells import cell_len

PACKAGE = Path(drop_physics.__file__).parent
FILE = LOCALE / "ja/LC_MESSAGES/drop.mo"
JAPANESE = re.compile("[\u3040-\u30ff\u4e00-\u9fff]")


def catalogue() -> dict[str, str]:
    with FILE.open("rb") as file:
        messages = dict(gettext.GNUTranslations(file)._catalog)  # type: ignore[attr-defined]
    del messages[""]
    return messages


def fields(template: str) -> list[tuple[str, str | None, str | None]]:
    """Return a template's fields: name, format and conversion."""
    parsed = string.Formatter().parse(template)
    return sorted((name, kind, how) for _, name, kind, how in parsed if name is not None)


@pytest.fixture
def japanese(monkeypatch: pytest.MonkeyPatch) -> None:
    """Set the language to Japanese for the test."""
    monkeypatch.setenv("DROP_LANG", "ja")


class Complete(gettext.GNUTranslations):
    """The Japanese messages, with a placeholder character for each untranslated word."""

    def gettext(self, message: str) -> str:
        """Return the translation of a message."""
        known = super().gettext(message)
        return known if known != message else re.sub(r"\w+(?![^{]*\}|[^\[]*\])", "訳", message)


@pytest.fixture
def complete(monkeypatch: pytest.MonkeyPatch) -> None:
    """Set the language to Japanese, with placeholders for missing translations."""
    with FILE.open("rb") as file:
        translations = Complete(file)
    monkeypatch.setenv("DROP_LANG", "ja")
    monkeypatch.setattr("drop_physics.messages._catalog", lambda *_: translations)


class Wide(io.StringIO):
    """A stream that acts as a terminal."""

    def isatty(self) -> bool:
        """Return True: the stream is a terminal."""
        return True


# -- the catalogue --------------------------------------------------------------------------------


@pytest.mark.long
def test_a_template_is_a_literal() -> None:
    """Only literals can be looked up; `fields.counted` alone takes a template as an argument."""
    for path in PACKAGE.rglob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            name = getattr(getattr(node, "func", None), "id", None)
            place = TEMPLATES.get(str(name))
            if isinstance(node, ast.Call) and place is not None and path.name != "fields.py":
                for template in node.args[place : place + 1]:
                    assert not isinstance(template, ast.JoinedStr | ast.BinOp | ast.IfExp), path


@pytest.mark.long
def test_how_many_messages_wait_for_a_translation(
    record_property: Callable[[str, str], None],
) -> None:
    """Untranslated messages are shown in English: a new sentence fails no test."""
    there, known = dict(templates()), catalogue()
    waiting = there.keys() - known.keys()
    assert len(there) > 1000
    assert len(waiting) < len(there)
    gone = len(known.keys() - there.keys())
    record_property(
        "say",
        f"Japanese: {len(waiting)} of {len(there)} messages wait for a translation, {gone} "
        "translations have no message; python docs/regenerate.py drop.po lists them",
    )


def test_a_translation_takes_what_its_template_takes() -> None:
    for template, translation in catalogue().items():
        if "{" in template:
            assert fields(translation) == fields(template), template
        markup = r"\[(?:/|bold|dim|red|yellow)\]"
        assert re.findall(markup, translation) == re.findall(markup, template)


def test_a_translation_keeps_options_calls_and_files() -> None:
    """They are typed literally; none may be lost, misspelled or translated."""
    names = re.compile(
        r"--[a-z][a-z-]*|\bp\.\w+|\w+\.(?:urdf|rrd|gif|mp4)"
        r"|\bdrop (?:simulate|analyze|render|run|check|sweep|record|view|info)\b"
    )
    for template, translation in catalogue().items():
        assert set(names.findall(translation)) == set(names.findall(template)), template


# -- whose language it is -------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("variables", "expected"),
    [
        ({}, "Contacts"),
        ({"LANG": "ja_JP.UTF-8"}, "接触"),
        ({"LANG": "ja"}, "接触"),
        ({"LC_ALL": "ja_JP.UTF-8", "LANG": "en_US.UTF-8"}, "接触"),
        ({"LC_MESSAGES": "ja_JP.UTF-8", "LANG": "de_DE.UTF-8"}, "接触"),
        ({"LANG": "en_US.UTF-8"}, "Contacts"),
        ({"LANG": "C"}, "Contacts"),
        ({"LANG": "xx_YY.UTF-8"}, "Contacts"),
        ({"DROP_LANG": "ja"}, "接触"),
        ({"DROP_LANG": "ja", "LANG": "en_US.UTF-8", "LC_ALL": "C"}, "接触"),
        ({"DROP_LANG": "en", "LANG": "ja_JP.UTF-8"}, "Contacts"),
        ({"DROP_LANG": "xx", "LANG": "ja_JP.UTF-8"}, "Contacts"),
        ({"DROP_LANG": "", "LANG": "ja_JP.UTF-8"}, "接触"),
        ({"DROP_LANG": "en", "LANGUAGE": "ja"}, "Contacts"),
        ({"LANGUAGE": "ja:en", "LANG": "en_US.UTF-8"}, "接触"),
        ({"LANGUAGE": "en:ja", "LANG": "ja_JP.UTF-8"}, "Contacts"),
    ],
)
def test_the_language_is_that_of_drop_lang_else_of_the_locale(
    monkeypatch: pytest.MonkeyPatch, variables: dict[str, str], expected: str
) -> None:
    for name in VARIABLES:
        monkeypatch.delenv(name, raising=False)
    for name, text in variables.items():
        monkeypatch.setenv(name, text)
    assert localized("Contacts") == expected


@pytest.mark.usefixtures("japanese")
def test_messages_within_messages_are_translated_too() -> None:
    noun = counted(2, "sample")
    assert translated(noun) == "2 サンプル"
    both = joined(", ", [noun, "a name", Message("none")]) + "!"
    assert both == "2 samples, a name, none!"
    assert translated(both) == "2 サンプル、a name、なし!"
    assert translated("none") == "none"  # a name that somebody gave
    assert translated(Message("")) == ""
    assert translated(Message("never said, {n}", n=1)) == "never said, 1"


# -- what is printed ------------------------------------------------------------------------------

CODE = re.compile(
    r"\S*[\w)]\.[a-z]\S*|--[\w-]+|[a-z]+(?:-[a-z]+)+|\bdrop view\b|\w+=\w+|\d[\d.e+-]*|\(body,"
)
NAMES = {"PyBullet", "Bullet", "mm", "Ns", "kB", "run", "rrd", "gif", "png", "linearDamping"}


@pytest.mark.long
@pytest.mark.usefixtures("japanese")
def test_what_a_code_means_is_in_japanese() -> None:
    """A rule's message shows … in place of a finding's value, in either language."""
    known = catalogue()
    shown = [
        text
        for reference in references(ALL_RULES).values()
        for text in (reference.meaning, *reference.measured, *reference.says)
        if getattr(text, "template", "") in known
    ]
    assert len(shown) > 100
    for text in shown:
        assert JAPANESE.search(translated(text))
        assert "…" in translated(text) or "…" not in text
        assert "{" not in translated(text)


@pytest.mark.usefixtures("complete")
def test_the_story_of_the_standard_drop_has_no_english_left(standard: Run) -> None:
    story = str(standard).replace(str(standard.simulation.recording.parent), "")
    words = re.findall(r"[A-Za-z]{2,}", CODE.sub(" ", story))
    assert set(words) <= NAMES
    assert "default-damping" in story


def test_in_english_the_same_story_has_no_japanese(standard: Run) -> None:
    assert not JAPANESE.search(str(standard))


@pytest.mark.usefixtures("japanese")
@pytest.mark.parametrize("columns", [50, 80, 100])
def test_lines_fit_the_terminal_counted_in_columns(
    monkeypatch: pytest.MonkeyPatch, standard: Run, columns: int
) -> None:
    monkeypatch.setattr(sys, "stdout", Wide())
    monkeypatch.setenv("COLUMNS", str(columns))
    lines = str(standard.analysis).splitlines()
    widths = [cell_len(line) for line in lines]
    assert max(widths) <= columns
    assert not [line for line in lines if line.strip()[:1] in set("、。」)")]
    assert any(line.startswith("静止" + 8 * " ") for line in lines), "12 columns, as in English"


def test_lines_end_between_phrases() -> None:
    """No line begins with `、` or a particle, or splits a word, or a number from its unit."""
    text = "モーターの力が 720 ステップ中 72 ステップで「上限」の 30 N m に達しています。"
    text += "p.setGravity(0, 0) を呼ぶ"
    assert wrapped(text, 24, indent=" ") == [
        "モーターの力が",
        " 720 ステップ中",
        " 72 ステップで「上限」の",
        " 30 N m に達しています。",
        " p.setGravity(0, 0) を",
        " 呼ぶ",
    ]
    assert wrapped("床にめり込みます", 12) == ["床にめり込みます"], "めり込み is one word"
    assert wrapped("ends at 30 N m, not 31", 13) == ["ends at 30 N", "m, not 31"]


def test_columns_are_where_they_are_in_english(
    monkeypatch: pytest.MonkeyPatch, standard: Run
) -> None:
    ends = []
    for language, rest, term in (("en", "Rest", "damping"), ("ja", "静止", "減衰")):
        monkeypatch.setenv("DROP_LANG", language)
        lines = str(standard).splitlines()
        heading = re.match(r"\S+ +", next(line for line in lines if line.startswith(rest)))
        assert heading is not None
        row = next(line for line in lines if line.startswith(f"  {term}"))
        ends.append((cell_len(heading.group()), cell_len(row.partition(" mm")[0])))
    assert ends[0] == ends[1]


@pytest.mark.parametrize(
    "command", ["analyze RUN --out layer.rrd --force", "info RUN", "check RUN --against RUN"]
)
def test_json_is_the_same_in_both_languages(drop: Drop, standard: Run, command: str) -> None:
    words = command.replace("RUN", str(standard.simulation.recording)).split()
    english, japanese = (drop(*words, "--json", DROP_LANG=language) for language in ("en", "ja"))
    assert japanese.stdout == english.stdout
    assert english.stdout.startswith("{")
    assert not JAPANESE.search(english.stdout)


def test_only_what_is_shown_is_translated() -> None:
    """Results, recordings and Python errors stay English because no other code translates."""
    translates = {
        path.relative_to(PACKAGE).parts[0]
        for path in PACKAGE.rglob("*.py")
        if re.search(r"\b(translated|localized)\(", path.read_text(encoding="utf-8"))
    }
    assert translates == {"console", "figures", "messages.py", "report"}


@pytest.mark.usefixtures("japanese")
def test_what_is_recorded_stays_english(standard: Run) -> None:
    assert not JAPANESE.search(standard.analysis.markdown())


@pytest.mark.pybullet
@pytest.mark.parametrize(
    ("command", "code", "beginning"),
    [
        ("analyze no.rrd", 1, "drop: no.rrd がありません"),
        ("simulate --out a.rrd --timestep 2", 2, "drop: --duration は時間刻み 2 s の整数倍"),
        ("simulate --out a.rrd --height x", 2, "drop: --height には数または"),
        ("render a.rrd --fps x", 2, "drop: --fps には数または"),
    ],
)
def test_an_error_is_one_line_in_japanese(
    drop: Drop, command: str, code: int, beginning: str
) -> None:
    done = drop(*command.split(), DROP_LANG="ja")
    assert (done.returncode, done.stdout) == (code, "")
    assert done.stderr.startswith(beginning)
    assert done.stderr.count("\n") == 1


@pytest.mark.usefixtures("japanese")
def test_in_python_an_error_is_in_english(tmp_path: Path) -> None:
    with pytest.raises(RecordingError) as raised:
        analyze(tmp_path / "no.rrd")
    assert not JAPANESE.search(str(raised.value) + repr(raised.value))


def test_help_loads_neither_rich_nor_a_translation() -> None:
    code = (
        "import sys; sys.argv = ['drop', '--help']\n"
        "from drop_physics import cli\n"
        "try: cli.main()\n"
        "except SystemExit: pass\n"
        "from drop_physics.messages import _catalog\n"
        "print('rich' in sys.modules, _catalog.cache_info().currsize, file=sys.stderr)\n"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stderr.split() == ["False", "0"]


# -- plots ----------------------------------------------------------------------------------------


def texts(analysis: Analysis) -> set[str]:
    with style.themed(LIGHT):
        figure = build_figure(plot_of(analysis), LIGHT)
        assert is_within(figure)
    return {text.get_text() for text in figure.findobj(Text)} - {""}


@pytest.fixture
def font(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Callable[[str], None]]:
    """Return a function that installs a font with a name, whose glyphs are all boxes."""
    before = list(font_manager.fontManager.ttflist)

    def install(name: str) -> None:
        letters = {ord(letter) for text in catalogue().values() for letter in text}
        pen = TTGlyphPen(None)
        pen.moveTo((0, 0))
        for corner in ((0, 700), (900, 700), (900, 0)):
            pen.lineTo(corner)
        pen.closePath()
        builder = FontBuilder(1000, isTTF=True)
        builder.setupGlyphOrder([".notdef", "box"])
        builder.setupCharacterMap(dict.fromkeys(letters, "box"))
        builder.setupGlyf({".notdef": pen.glyph(), "box": pen.glyph()})
        builder.setupHorizontalMetrics({".notdef": (1000, 0), "box": (1000, 0)})
        builder.setupHorizontalHeader(ascent=800, descent=-200)
        builder.setupNameTable({"familyName": name, "styleName": "Regular"})
        builder.setupOS2()
        builder.setupPost()
        builder.save(tmp_path / "font.ttf")  # later than matplotlib made its list
        style.japanese_font.cache_clear()

    others = [one for one in before if one.name not in style.JAPANESE]
    monkeypatch.setattr(font_manager.fontManager, "ttflist", others)
    monkeypatch.setattr(
        font_manager, "findSystemFonts", lambda: [*map(str, tmp_path.glob("*.ttf"))]
    )
    style.japanese_font.cache_clear()
    yield install
    style.japanese_font.cache_clear()


@pytest.mark.long
@pytest.mark.usefixtures("japanese")
def test_a_plot_is_in_japanese_where_a_font_is_installed(
    font: Callable[[str], None], caplog: pytest.LogCaptureFixture, standard: Run
) -> None:
    font("IPAexGothic")
    shown = texts(standard.analysis)
    assert {"時間 [s]", "中心の高さ [m]", "自由落下", "時間刻み", "合計"} <= shown
    assert render(plot_of(standard.analysis), "png", dark=False)  # and no glyph is missing
    assert [record.getMessage() for record in caplog.records] == []  # nor a bold face


@pytest.mark.long
@pytest.mark.usefixtures("japanese")
def test_without_one_it_is_in_english(
    font: Callable[[str], None], monkeypatch: pytest.MonkeyPatch, standard: Run
) -> None:
    font("Some Font")
    story, english = plot_of(standard.analysis), texts(standard.analysis)
    assert not JAPANESE.search("".join(english))
    drawn = render(story, "svg", dark=False)
    monkeypatch.setenv("DROP_LANG", "en")
    assert drawn == render(story, "svg", dark=False)


@pytest.mark.long
def test_an_english_plot_takes_no_other_font(font: Callable[[str], None], standard: Run) -> None:
    story = plot_of(standard.analysis)
    drawn = render(story, "svg", dark=False)
    font("IPAexGothic")
    assert drawn == render(story, "svg", dark=False)
