"""The search of contacts: cells, neighbors, the list and its order."""
