"""Text for people: shares, errors, and the glossary."""
