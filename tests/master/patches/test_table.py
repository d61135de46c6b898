"""The documentation of the patch table is what the code does."""

from tests.master.patches.patch_table_doc import BEGIN, DOC, END, generated


def test_document_holds_what_the_code_says():
    _, _, rest = DOC.read_text().partition(BEGIN)
    assert rest.partition(END)[0].strip() == generated()
