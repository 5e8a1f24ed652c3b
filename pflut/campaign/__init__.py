"""Campaigns: many simulated drives with many filters, resumable, summed up and compared."""

from __future__ import annotations

from typing import TYPE_CHECKING

from pflut._lazy import lazy

if TYPE_CHECKING:
    from pflut.campaign.drives import Campaign as Campaign
    from pflut.campaign.drives import run_campaign as run_campaign
    from pflut.campaign.drives import run_drive as run_drive
    from pflut.campaign.filters import FILTERS as FILTERS
    from pflut.campaign.outcome import DriveOutcome as DriveOutcome
    from pflut.campaign.summary import read_campaign as read_campaign
    from pflut.campaign.summary import summarize_outcomes as summarize_outcomes

_NAMES = {
    "Campaign": "drives",
    "DriveOutcome": "outcome",
    "FILTERS": "filters",
    "read_campaign": "summary",
    "run_campaign": "drives",
    "run_drive": "drives",
    "summarize_outcomes": "summary",
}

__getattr__, __dir__, __all__ = lazy(__name__, _NAMES)
