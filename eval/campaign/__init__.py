"""Many simulated sessions of one platform, as files."""

from eval.campaign.platform_sessions import SHORT_ORDERS, write_platform_sessions

__all__ = ["SHORT_ORDERS", "write_platform_sessions"]
