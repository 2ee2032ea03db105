"""Package, because another folder has a test_markers, too."""
