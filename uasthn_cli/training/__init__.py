"""Train the estimators that ship with the tool."""
