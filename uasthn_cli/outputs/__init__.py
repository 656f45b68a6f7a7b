"""Write results: tables, GeoJSON, the run record; whole files or none."""
