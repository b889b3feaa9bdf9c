import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gelforge.csv_table import CsvForm, TableError, read_comments, read_csv


def written(tmp_path, text, encoding="utf-8"):
    path = tmp_path / "table.csv"
    path.write_bytes(text.encode(encoding))
    return path


@pytest.mark.parametrize(
    "text",
    [
        "a,b,name\n1.5,2,x\n3,,y\n",
        "# comment\n\n% another, with; marks\na;b;name\n1,5;2;x\n3;;y\n",
        "a; b ;name\r\n1.5;2;x\r\n3;;y\r\n",
        "\ufeffa,b,name,extra\n1.5,2,x,kept\n\n3,,y,\n",
    ],
)
def test_every_way_of_writing_reads_the_same(tmp_path, text):
    table = read_csv(
        written(tmp_path, text),
        numbers=["a"],
        optional_numbers=["b", "c"],
        texts=["name"],
        optional_texts=["note"],
    )
    assert table["a"].tolist() == [1.5, 3.0]
    assert table["b"].iloc[0] == 2
    assert np.isnan(table["b"].iloc[1])
    assert table["c"].isna().all()
    assert table["name"].tolist() == ["x", "y"]
    assert table["note"].tolist() == ["", ""]


def test_rows_are_numbered_as_lines_and_their_ends_move_nothing(tmp_path):
    # Rows are numbered as an editor numbers lines
    path = written(tmp_path, "# one\n# two\na\n1\n\n2\n")
    assert read_csv(path, numbers=["a"]).index.tolist() == [4, 6]
    assert read_comments(path) == ["one", "two"]

    # Ends of rows move nothing
    table = read_csv(written(tmp_path, "a b\n1  2 \n3 4\n"), numbers=["a", "b"], form=CsvForm(separator=" "))
    assert table["b"].tolist() == [2.0, 4.0]

    # A row of units may lack the separators at the end of the rows below
    text = "a,b\nmm,N\n1,2,\n3,4,\n"
    table = read_csv(written(tmp_path, text), numbers=["a", "b"], form=CsvForm(units_row=None))
    assert table["b"].tolist() == [2.0, 4.0]

    # A file without a table is named
    with pytest.raises(TableError, match="no header line"):
        read_csv(written(tmp_path, "# only a comment\n"), form=CsvForm(find_header=True))

    # Other encodings and missing files are named
    with pytest.raises(TableError, match="byte 0 is not UTF-8"):
        read_csv(written(tmp_path, "µ,b\n1,2\n", "latin-1"))
    with pytest.raises(TableError, match=r"nowhere\.csv: no such file"):
        read_csv(tmp_path / "nowhere.csv")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a,b\n1,2\n", r"row 1: columns \['name'\] are missing; found \['a', 'b'\]"),
        ("# c\na,name\n1,x\nnan,y\n", r"row 4: a is 'nan'; a finite number is needed"),
        ("a,name\n1,x\ninf,y\n", r"row 3: a is 'inf'"),
        ("a,name\n,x\n", r"row 2: a is nothing"),
        ("a,name\n1,\n", r"row 2: name is empty"),
        ("a;name\n1.234,5;x\n", r"row 2: a is '1.234,5'"),
        ("a,name\n1,5,x\n", r"row 2: 3 values for 2 columns.*decimal commas need semicolons"),
        ("a,name\n1,x\n2\n", r"row 3: 1 values for 2 columns; complete the row"),
        ("a,name,a\n1,x,2\n", r"row 1: columns \['a'\] are there twice"),
        ("a,name\n", "no rows below the header"),
        ("# only a comment\n", "no header line"),
    ],
)
def test_what_cannot_be_read_says_where_and_what_to_do(tmp_path, text, message):
    with pytest.raises(TableError, match=r"table\.csv.*" + message):
        read_csv(written(tmp_path, text), numbers=["a"], texts=["name"])


CELLS = st.lists(
    st.lists(st.sampled_from(["", "1", "2.5", "x"]), min_size=3, max_size=3), min_size=2, max_size=5
)


@given(
    CELLS.map(lambda rows: [["1", *row] for row in rows]),
    st.data(),
    st.sampled_from(",;\t"),
    st.integers(0, 2),
    st.booleans(),
)
def test_a_separator_too_many_in_one_row_is_refused_and_in_all_rows_ignored(
    tmp_path_factory, rows, data, separator, trailing, in_header
):
    """Whatever the cells: no value ever lands in another column without a word."""
    path = tmp_path_factory.mktemp("table") / "table.csv"
    header = ["a", "b", "c", "d"]
    end = [""] * trailing

    def read(rows):
        lines = [header + (end if in_header else []), *(row + end for row in rows)]
        path.write_text("".join(separator.join(cells) + "\n" for cells in lines))
        return read_csv(path, form=CsvForm(separator=separator))

    assert [list(row) for row in read(rows).to_numpy()] == rows  # the same surplus in all rows
    at = data.draw(st.integers(0, len(rows) - 1))
    before = data.draw(st.integers(0, 4))
    shifted = [*rows[at][:before], "", *rows[at][before:]]
    with pytest.raises(TableError, match=rf"row {at + 2}: {5 + trailing} (cells|values) for 4 columns"):
        read([*rows[:at], shifted, *rows[at + 1 :]])


@pytest.mark.parametrize(
    ("text", "form", "remedy"),
    [
        ("a\tb\n1\t2\n3\t4\n", CsvForm(), "separated by tabs, save the table with commas or semicolons"),
        ("a;b\n1,5;2\n3,5;4\n", CsvForm(separator=","), r"separated by semicolons, set `separator: ';'`"),
        ("Report\nprobe\n\na\tb\n1\t2\n3\t4\n", CsvForm(separator=",", find_header=True), "separator: tab"),
        ("Zeit;Weg, mm\n1;2\n3;4\n", CsvForm(separator="\t"), r"in one column: .* `separator: ';'`"),
        ("t\n1\n2\n", CsvForm(), "found \\['t'\\], name them so in the header"),
        ("a b c\n1 2 3\n", CsvForm(separator=","), "separator: space"),
        ("a|b\n1|2\n", CsvForm(separator=","), "separated by vertical bars, save the table with commas"),
        ("x;a;b\n0;1;2\n", CsvForm(separator=",", comment=""), "separated by semicolons"),
    ],
)
def test_a_table_of_one_column_says_which_separator_it_seems_to_have(tmp_path, text, form, remedy):
    with pytest.raises(TableError, match=rf"row \d: columns .* are missing.*{remedy}"):
        read_csv(written(tmp_path, text), numbers=["a", "b"], form=form)
