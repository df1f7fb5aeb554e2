from core.errors import RallyscopeError


def test_a_message_is_one_line_with_all_its_parts() -> None:
    error = RallyscopeError("no such\nthing", expected="a", got="b", where="file.h5", remedy="do this")
    assert str(error) == "file.h5: no such thing; expected a, got b; do this"


def test_parts_that_are_absent_leave_no_trace() -> None:
    assert str(RallyscopeError("plain")) == "plain"
    assert str(RallyscopeError("zero", got=0)) == "zero; got 0"
