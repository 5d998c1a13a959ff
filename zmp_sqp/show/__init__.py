"""Plans and motions shown: figures, tables on the terminal, JSON results."""
