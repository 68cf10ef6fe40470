"""Pictures and figures of BRDFs."""
