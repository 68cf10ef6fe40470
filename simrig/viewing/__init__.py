"""Pictures for people: stimuli, structure over distance, the room, figures of BRDFs."""
