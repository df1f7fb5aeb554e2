"""What a person says about a recording: the label model, its store, assistance and exchange formats.

No user interface.
"""
