"""Results as tables, pages, pictures and files of other systems."""
