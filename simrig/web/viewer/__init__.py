"""The viewer: materials side by side in the browser, lit as the mouse says."""
