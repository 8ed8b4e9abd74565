"""What a recording says: one object, of which table, sentence, figure and JSON are made."""
