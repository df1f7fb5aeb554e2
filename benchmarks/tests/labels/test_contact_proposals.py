from __future__ import annotations

from benchmarks.labels.contact_proposals import RallyContacts, figures_of
from labels.model import ContactKind, ContactLabel


def contact(t_us: int, kind: ContactKind) -> ContactLabel:
    return ContactLabel(t_us=t_us, kind=kind)


def test_what_is_found_missed_of_another_kind_or_false_is_counted_apart() -> None:
    truth = tuple(contact(t_us, kind) for t_us, kind in ((100_000, ContactKind.BOUNCE), (300_000, ContactKind.HIT)))
    truth += (contact(500_000, ContactKind.BOUNCE), contact(700_000, ContactKind.HIT))
    proposed = (contact(100_200, ContactKind.BOUNCE), contact(300_400, ContactKind.NET))
    proposed += (contact(600_000, ContactKind.HIT), contact(700_600, ContactKind.HIT))
    rally = RallyContacts(truth, proposed, ((0, 0), (1, 1), (3, 3)), (2, 2, 1, 2))
    every, bounce, hit = figures_of([rally])
    assert (every.true, every.found, every.wrong_kind, every.false) == (4, 2, 1, 1)
    assert (bounce.true, bounce.found, bounce.false, bounce.hidden_missed) == (2, 1, 0, 1)
    assert (hit.true, hit.found, hit.wrong_kind, hit.false) == (2, 1, 1, 1)
    assert abs(every.median_ms - 0.4) < 1e-9 and abs(bounce.median_ms - 0.2) < 1e-9
