"""The ellipsoidal reflector: folded and traced models of its pictures."""
