"""What the page runs beside its server: evolutions, films and trials of trees, in processes of their own."""
