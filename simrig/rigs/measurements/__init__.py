"""What rigs recorded, and how it is stored."""
