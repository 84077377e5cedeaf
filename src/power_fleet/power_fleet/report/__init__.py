"""Page, figures and tables of histories."""
