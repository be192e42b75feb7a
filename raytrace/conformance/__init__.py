"""Scenes whose light has a closed form, and the judgement of any renderer's images of them."""
