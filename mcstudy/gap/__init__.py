"""From a recording to where a model fails, which effect is missing, and how far adding it closes the gap."""
