"""How well balls come back where what is believed of the lab is wrong, and nobody says what is right."""
