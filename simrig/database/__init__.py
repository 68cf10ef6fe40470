"""What is known before a measurement: databases of BRDFs, their basis, and what follows from it."""
