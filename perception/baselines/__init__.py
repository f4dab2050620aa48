"""Published methods that the estimators are measured against, each as our reading of it."""
