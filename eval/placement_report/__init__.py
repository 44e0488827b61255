"""What a plan of anchors looks like to its user: numbers as JSON and GeoJSON, tables, maps and one page."""
