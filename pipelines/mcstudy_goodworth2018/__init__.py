"""The study of Goodworth & Peterka (2018): its published numbers, solver and lost table, attached to mcstudy."""
