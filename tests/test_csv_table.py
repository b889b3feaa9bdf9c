import numpy as np
import pytest

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


def test_rows_are_numbered_as_an_editor_numbers_lines(tmp_path):
    path = written(tmp_path, "# one\n# two\na\n1\n\n2\n")
    assert read_csv(path, numbers=["a"]).index.tolist() == [4, 6]
    assert read_comments(path) == ["one", "two"]


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


def test_a_header_that_is_searched_for_may_be_missing_too(tmp_path):
    with pytest.raises(TableError, match="no header line"):
        read_csv(written(tmp_path, "# only a comment\n"), form=CsvForm(find_header=True))


def test_other_encodings_and_missing_files_are_named(tmp_path):
    with pytest.raises(TableError, match="byte 0 is not UTF-8"):
        read_csv(written(tmp_path, "µ,b\n1,2\n", "latin-1"))
    with pytest.raises(TableError, match=r"nowhere\.csv: no such file"):
        read_csv(tmp_path / "nowhere.csv")
