"""Who may use the page: which names it is served under, from which pages it is called, and who is logged in."""
