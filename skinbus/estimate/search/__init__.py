"""The search of levels ``fit`` and ``full``: one model, one least squares, one list of hypotheses."""
