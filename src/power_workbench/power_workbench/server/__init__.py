"""The server of the page: routes, answers, actions and their guard."""
