"""`palpate study …`: the studies, as tables on the terminal, as JSON and as files of results."""
