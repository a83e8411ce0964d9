"""What a composer writes: texts with places, musical time, tables of fields with their units."""
