"""Files and tables of branches."""
