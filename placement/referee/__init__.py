"""An independent referee: the value, the rules and the bound again, by other and plainer means."""
