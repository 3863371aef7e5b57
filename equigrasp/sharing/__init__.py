"""Policies as files and on the Hugging Face hub, and the card that says what was measured of them."""
