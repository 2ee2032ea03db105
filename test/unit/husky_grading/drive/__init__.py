"""Package, because another folder has a test_progress, too."""
