"""Fixtures of the live tests are those of the pose tests."""

from tests.pose.conftest import own_cache, real_videos

__all__ = ["own_cache", "real_videos"]
